"""Trajectories, and paths of frames, from files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, decimal
from phcontrol.exceptions import DataFileError
from phcontrol.mechanics.robot import Robot
from phcontrol.trajectories.sampled_frame_path import SampledFramePath
from phcontrol.trajectories.splines import SampledTrajectory

_POINT = ["time", "x", "y", "z"]
_QUATERNION = ["qx", "qy", "qz", "qw"]


def read_trajectory(path: str | os.PathLike[str], robot: Robot, *, smoothing: float = 0.0) -> SampledTrajectory:
    """Read a motion from a CSV file: a row for each instant, its time [s] and then one position a joint [rad].

    A first row with names is allowed; with it the columns may stand in any order, and must be "time" and the
    joints' names. Raises DataFileError; a file is read as numbers only.

    Args:
        path: of the file.
        robot: whose joints they are.
        smoothing: as in :class:`SampledTrajectory`.
    """
    table = _read(path, ["time", *robot.joint_names])
    return SampledTrajectory(table[:, 0], table[:, 1:], smoothing=smoothing)


def read_frame_path(path: str | os.PathLike[str], frame: str, *, smoothing: float = 0.0) -> SampledFramePath:
    """Read the path of a frame from a CSV file: a row for each instant, "time" [s], "x", "y", "z" [m].

    Then "qx", "qy", "qz", "qw", the unit quaternion of its rotation; without them the orientation is left free. A
    first row with these names is allowed; with it the columns may stand in any order. Raises DataFileError; a
    file is read as numbers only.

    Args:
        path: of the file.
        frame: name of the link or frame that moves.
        smoothing: as in :class:`SampledFramePath`.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> from phcontrol import read_frame_path
        >>> rows = ["time,x,y,z", *(f"{t},{0.5 + 0.1 * t},0.0,0.4" for t in (0.0, 0.5, 1.0, 1.5, 2.0))]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     with Path(folder, "path.csv").open("w") as file:
        ...         for row in rows:
        ...             print(row, file=file)
        ...     path = read_frame_path(Path(folder, "path.csv"), "hand")
        >>> path.at(2.0).position
        array([0.7, 0. , 0.4])
    """
    table = _read(path, _POINT, _QUATERNION)
    rotations = None
    if table.shape[1] > len(_POINT):
        lengths = np.hypot.reduce(table[:, 4:], axis=1)  # does not overflow
        wrong = np.flatnonzero(np.abs(lengths - 1.0) > 1e-3)
        if wrong.size:
            row = wrong[0]
            raise DataFileError(
                f"cannot read the trajectory {path}: the quaternion of row {row + 1} must have length 1, but has "
                f"{lengths[row]:.4g}"
            )
        rotations = np.array([pin.Quaternion(row).normalized().matrix() for row in table[:, 4:]])
    return SampledFramePath(frame, table[:, 0], table[:, 1:4], rotations, smoothing=smoothing)


def _read(path: str | os.PathLike[str], names: list[str], more: list[str] | None = None) -> Array:
    """Return the numbers of a file in the order of ``names``, and of ``more`` where it has these columns too."""
    try:
        if Path(path).exists() and not Path(path).is_file():
            raise OSError("it is a folder, or a pipe or device without an end")
        text = Path(path).read_text(encoding="utf-8-sig")  # spreadsheets begin a file with a byte-order mark
    except (OSError, ValueError) as error:  # bytes that are no text, a path that can be none
        raise DataFileError(f"cannot read the trajectory {path}: {error}") from error
    lines = [line.split(",") for line in text.splitlines() if line.strip()]
    if more and lines and len(lines[0]) > len(names):
        names = [*names, *more]
    order = list(range(len(names)))
    if lines and decimal(lines[0][0]) is None:
        header = [name.strip() for name in lines.pop(0)]
        if sorted(header) != sorted(names):
            raise DataFileError(f"cannot read the trajectory {path}: its columns must be {names}, but are {header}")
        order = [header.index(name) for name in names]
    rows = [[_number(path, k, cell) for cell in cells] for k, cells in enumerate(lines, start=1)]
    if not rows or any(len(row) != len(names) for row in rows):
        raise DataFileError(f"cannot read the trajectory {path}: each row must hold {len(names)} numbers: {names}")
    return np.array(rows)[:, order]


def _number(path: str | os.PathLike[str], row: int, text: str) -> float:
    value = decimal(text)
    if value is None:
        raise DataFileError(
            f"cannot read the trajectory {path}: row {row} holds '{text}', not a number such as 0.25 or 1e-3"
        )
    return value
