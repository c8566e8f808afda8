"""A camera from the file that its calibration wrote: OpenCV's YAML, or the camera_info of ROS (needs PyYAML)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from phcontrol._validation import Array, decimal
from phcontrol.exceptions import DataFileError, InvalidArgumentError, PHControlError
from phcontrol.vision.pinhole_camera import PinholeCamera

LARGEST = 200_000
"""Bytes that a file may have."""
MODELS = ("plumb_bob", "rational_polynomial")
"""Names that ROS has for OpenCV's model."""
_MATRIX_TAG = "tag:yaml.org,2002:opencv-matrix"


def read_camera(path: str | os.PathLike[str], *, frame: str | None = None, focal_length: float = 0.01) -> PinholeCamera:
    """Read a camera with image size, camera matrix and distortion from a calibration file.

    Of both formats the entries ``image_width``, ``image_height``, ``camera_matrix`` and ``distortion_coefficients`` are
    read; ``distortion_model`` must be OpenCV's ("plumb_bob" or "rational_polynomial"; a fisheye lens is refused).
    Nothing in a file is executed. Raises DataFileError.

    Args:
        path: of the file.
        frame: the frame of the arm that is the camera's, as of :class:`PinholeCamera`.
        focal_length: f [m], as of ``PinholeCamera.calibrated``.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> from phcontrol import read_camera
        >>> lines = ["image_width: 640", "image_height: 480", "distortion_model: plumb_bob"]
        >>> lines += ["camera_matrix: {rows: 3, cols: 3, data: [520, 0, 320, 0, 520, 240, 0, 0, 1]}"]
        >>> lines += ["distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}"]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     with Path(folder, "camera.yaml").open("w") as file:
        ...         for line in lines:
        ...             print(line, file=file)
        ...     camera = read_camera(Path(folder, "camera.yaml"))
        >>> camera.image_size, camera.matrix[0].round(6)
        ((640, 480), array([520.,   0., 320.]))
    """
    entries = _entries(path)
    try:
        model = entries.get("distortion_model", MODELS[0])
        if model not in MODELS or entries.get("fisheye_model", 0) not in (0, False, None):
            raise InvalidArgumentError(
                "distortion_model",
                f"must be {' or '.join(MODELS)} (a fisheye lens is not supported), but is {_short(model)}",
            )
        size = [_whole(entries, name) for name in ("image_width", "image_height")]
        matrix = _matrix(entries, "camera_matrix")
        distortion = _matrix(entries, "distortion_coefficients")
        if 1 not in distortion.shape and distortion.size:
            raise InvalidArgumentError("distortion_coefficients", f"must be a row or a column, not {distortion.shape}")
        return PinholeCamera.calibrated(matrix, distortion.ravel(), size, frame=frame, focal_length=focal_length)
    except InvalidArgumentError as error:
        raise DataFileError(f"{path} holds no camera: {error}") from error


def _entries(path: str | os.PathLike[str]) -> dict[str, Any]:
    try:
        import yaml
    except ImportError as error:
        raise PHControlError("calibration files need PyYAML: pip install 'phcontrol[vision]'") from error

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """YAML's plain values, and OpenCV's matrices as what they hold."""

    Loader.add_constructor(_MATRIX_TAG, lambda loader, node: loader.construct_mapping(node, deep=True))
    try:
        place = Path(path)
        if place.exists() and not place.is_file():
            raise OSError("it is a folder, or a pipe or device without an end")
        if place.stat().st_size > LARGEST:
            raise OSError(f"it is longer than {LARGEST} bytes, which no calibration is")
        text = place.read_text(encoding="utf-8-sig")
        if text.startswith("%YAML:"):  # OpenCV's first line is no YAML
            text = text.partition("\n")[2]
        entries = yaml.load(text, Loader)  # of SafeLoader
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise DataFileError(f"cannot read the calibration {path}: {' '.join(str(error).split())}") from error
    if not isinstance(entries, dict):
        raise DataFileError(f"cannot read the calibration {path}: it must hold names and values")
    return entries


def _entry(entries: dict[str, Any], name: str) -> Any:
    if name not in entries:
        raise InvalidArgumentError(name, f"is missing; there are {', '.join(map(str, entries)) or 'none'}"[:200])
    return entries[name]


def _whole(entries: dict[str, Any], name: str) -> int:
    value = _entry(entries, name)
    if type(value) is not int:
        raise InvalidArgumentError(name, f"must be a whole number of pixels, but is {_short(value)}")
    return value


def _matrix(entries: dict[str, Any], name: str) -> Array:
    """Return a matrix that is given by rows, cols and data."""
    value = _entry(entries, name)
    if not isinstance(value, dict) or not {"rows", "cols", "data"} <= value.keys():
        raise InvalidArgumentError(name, "must have rows, cols and data")
    rows, cols, data = _whole(value, "rows"), _whole(value, "cols"), value["data"]
    if not isinstance(data, list) or not 0 <= rows <= 20 or not 0 <= cols <= 20 or len(data) != rows * cols:
        raise InvalidArgumentError(name, f"must hold rows x cols numbers: {rows} x {cols}")
    return np.array([_number(name, item) for item in data]).reshape(rows, cols)


def _number(name: str, item: Any) -> float:
    """Return a number; YAML takes "1e-3" for a text."""
    number = float(item) if type(item) in (int, float) and abs(item) < 1e300 else None
    number = decimal(item) if isinstance(item, str) else number
    if number is None:
        raise InvalidArgumentError(name, f"must hold finite numbers, but one is {_short(item)}")
    return number


def _short(value: Any) -> str:
    """Return a value in a few words; of what is nested, which may be without end, the kind alone."""
    return repr(value)[:40] if isinstance(value, (str, float, bool)) else f"a {type(value).__name__}"
