"""A pinhole camera in the hand of an arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, count, finite_array, number, positive, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.vision.lens_distortion import LensDistortion

_BORDER_POINTS = 33  # along each side of the image, where a distortion is looked at


class Bounds(NamedTuple):
    """What of the image plane is in the image [m]; infinite without a field of view."""

    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera: z of its frame is the optical axis, x points right in the image and y down.

    A point (X, Y, Z) in the camera's frame falls on (μ, ν) = (f/Z)(X, Y) of the image plane [m]. Where in the image
    that is shown is OpenCV's model: bent by ``distortion``, then scaled, then shifted to ``principal_point``.
    Features are those of the image plane, so that no law sees the lens.

    Args:
        focal_length: f [m].
        frame: the frame of the arm that is the camera's; None for the robot's camera frame, or where it has none
            its tool frame, or else the last frame of the longest chain of joints.
        image_size: width and height [pixels]; None for a camera of which no images are made.
        field_of_view: horizontal angle that the image would cover if the principal point were its middle [rad]; None
            for an image plane without end, as the thesis's (then there are no pixels either). The vertical one follows
            from ``image_size``.
        principal_point: where the optical axis is in the image, (column, row) [pixels]; None for its middle.
        distortion: of the lens, OpenCV's coefficients as :class:`LensDistortion` takes them.
        pixel_aspect: width of a pixel over its height, which is f_y/f_x.

    Example:
        >>> import numpy as np
        >>> from phcontrol import PinholeCamera
        >>> camera = PinholeCamera(image_size=(640, 480), field_of_view=np.pi / 2)  # [pixels], [rad]
        >>> camera.to_pixels([0.0, 0.0, 0.002]).round(6)  # column, row, length
        array([319.5, 239.5,  64. ])
        >>> camera.sees(np.array([0.0, 0.0, 0.002])), camera.sees(np.array([0.02, 0.0, 0.002]))
        (True, False)
    """

    focal_length: float = 0.01
    frame: str | None = None
    image_size: tuple[int, int] | None = None
    field_of_view: float | None = None
    principal_point: tuple[float, float] | None = None
    distortion: tuple[float, ...] = ()
    pixel_aspect: float = 1.0

    def __post_init__(self) -> None:
        positive("focal_length", self.focal_length)
        number("pixel_aspect", self.pixel_aspect, minimum=0.1, maximum=10.0)
        if self.field_of_view is not None:
            number("field_of_view", self.field_of_view, minimum=0.0, exclusive=True, maximum=math.pi - 1e-3)
        if self.image_size is not None:
            if len(self.image_size) != 2:
                raise InvalidArgumentError("image_size", f"must be (width, height), but is {self.image_size!r}")
            for side in self.image_size:
                count("image_size", side, minimum=8)
            if self.field_of_view is None:
                raise InvalidArgumentError("field_of_view", "is needed for images: how wide they are [rad]")
        lens = LensDistortion(self.distortion)
        object.__setattr__(self, "distortion", lens.coefficients)
        if self.image_size is None:
            for name, given in (("principal_point", self.principal_point), ("distortion", self.distortion or None)):
                if given is not None:
                    raise InvalidArgumentError(name, "is that of an image: give image_size and field_of_view too")
        middle = self._middle()
        object.__setattr__(self, "_lens", None if lens.is_none else lens)
        object.__setattr__(self, "_axis", middle)
        object.__setattr__(self, "_bounds", self._find_bounds())

    @classmethod
    def calibrated(
        cls,
        camera_matrix: ArrayLike,
        distortion: ArrayLike = (),
        image_size: Sequence[int] = (640, 480),
        *,
        frame: str | None = None,
        focal_length: float = 0.01,
    ) -> PinholeCamera:
        """Return the camera of which OpenCV's calibration gives this matrix and these coefficients.

        Args:
            camera_matrix: [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]] [pixels].
            distortion: as :class:`LensDistortion` takes it.
            image_size: width and height [pixels].
            frame: as of the class.
            focal_length: f [m]: the scale in which features are given, free to choose where all else is in pixels.
        """
        matrix = finite_array("camera_matrix", camera_matrix)
        if matrix.shape != (3, 3) or matrix[[0, 1, 2, 2], [1, 0, 0, 1]].any() or matrix[2, 2] != 1.0:
            raise InvalidArgumentError(
                "camera_matrix", f"must be [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]], but is {matrix.tolist()}"
            )
        along, down = positive("camera_matrix", matrix[0, 0]), positive("camera_matrix", matrix[1, 1])
        if len(image_size) != 2:
            raise InvalidArgumentError("image_size", f"must be (width, height), but is {image_size!r}")
        width = count("image_size", image_size[0], minimum=8)
        return cls(
            focal_length,
            frame,
            (width, count("image_size", image_size[1], minimum=8)),
            2.0 * math.atan(0.5 * width / along),
            (float(matrix[0, 2]), float(matrix[1, 2])),
            tuple(np.ravel(finite_array("distortion", distortion)).tolist()),
            down / along,
        )

    def mounted_on(self, robot: Robot, frame: str | None = None) -> PinholeCamera:
        """Return the camera with its frame named: ``frame``, else its own, else the robot's; it must exist."""
        name = frame or self.frame or camera_frame(robot)
        robot.frame_id(name)
        return self if name == self.frame else replace(self, frame=name)

    def record(self) -> dict[str, Any]:
        """Return what a viewer needs to draw it, for JSON; an image plane without end has no half size."""
        half = [value if math.isfinite(value) else None for value in self.half_size]
        return {"frame": self.frame, "focal_length": self.focal_length, "half_size": half}

    @property
    def bounds(self) -> Bounds:
        """What of the image plane is in the image [m]; of a lens that bends it, the smallest rectangle about that."""
        bounds: Bounds = self.__dict__["_bounds"]
        return bounds

    @property
    def half_size(self) -> tuple[float, float]:
        """How far from the optical axis the image reaches on both sides [m]; infinite without a field of view."""
        left, top, right, bottom = self.bounds
        return min(-left, right), min(-top, bottom)

    def sees(self, features: Array) -> bool:
        """Whether features (μ, ν, l) are those of an object in front of the camera and in its image."""
        mu, nu, size = features.tolist()
        left, top, right, bottom = self.bounds
        if not (0.0 < size < math.inf and left <= mu <= right and top <= nu <= bottom):
            return False
        return self.__dict__["_lens"] is None or self._shows(features)

    def why_not_seen(self, features: Array) -> str:
        """Return in words why an object with these features is not seen; empty if it is."""
        mu, nu, size = features.tolist()
        if math.isnan(mu + nu + size):
            return "no object is found in the image"
        if not 0.0 < size < math.inf:
            return f"it is not in front of the camera (length {size:g} m in the image, so a depth Z <= 0)"
        if self.sees(features):
            return ""
        left, top, right, bottom = self.bounds
        return f"it has left the image: ({mu:g}, {nu:g}) m is outside ({left:g} to {right:g}, {top:g} to {bottom:g}) m"

    # --- pixels -----------------------------------------------------------------------------------

    @property
    def pixel_size(self) -> float:
        """Width of a pixel on the image plane [m]. Raises InvalidArgumentError without an image."""
        if self.image_size is None or self.field_of_view is None:
            raise InvalidArgumentError("image_size", "this camera has no pixels: give image_size and field_of_view")
        return 2.0 * self.focal_length * math.tan(self.field_of_view / 2.0) / self.image_size[0]

    @property
    def matrix(self) -> Array:
        """OpenCV's camera matrix, shape (3, 3) [pixels]."""
        along = self.focal_length / self.pixel_size
        column, row = self.__dict__["_axis"]
        return np.array([[along, 0.0, column], [0.0, self.pixel_aspect * along, row], [0.0, 0.0, 1.0]])

    def to_pixels(self, features: ArrayLike) -> Array:
        """Return (column, row, length) in pixels; (0, 0) is the centre of the first pixel.

        The length is in widths of a pixel where the lens bends nothing.
        """
        given = finite_array("features", features)
        pixels = given / self.pixel_size
        pixels[..., :2] = self.to_image(given[..., :2])
        return pixels

    def from_pixels(self, pixels: ArrayLike) -> Array:
        """Return the features (μ, ν, l) [m] of (column, row, length) in pixels: the inverse of ``to_pixels``."""
        given = finite_array("pixels", pixels)
        features: Array = given * self.pixel_size
        features[..., :2] = self.from_image(given[..., :2])
        return features

    def to_image(self, points: ArrayLike) -> Array:
        """Return (column, row), shape (..., 2) [pixels], where points (μ, ν) [m] are shown."""
        lens = self.__dict__["_lens"]
        if lens is not None:
            points = self.focal_length * lens.distorted(np.asarray(points) / self.focal_length)
        shown: Array = np.asarray(points) / self._pixel_sides() + self.__dict__["_axis"]
        return shown

    def from_image(self, pixels: ArrayLike) -> Array:
        """Return the points (μ, ν), shape (..., 2) [m], that are shown at (column, row) [pixels].

        NaN beyond where the model of the lens folds over.
        """
        points: Array = (np.asarray(pixels) - self.__dict__["_axis"]) * self._pixel_sides()
        lens = self.__dict__["_lens"]
        if lens is not None:
            points = self.focal_length * lens.undistorted(points / self.focal_length)
        return points

    def pixel_areas(self, points: Array) -> Array:
        """Return how large a pixel that shows a point (μ, ν) is on the image plane, shape (...) [m²]."""
        lens = self.__dict__["_lens"]
        area = float(self._pixel_sides().prod())
        if lens is None:
            return np.full(points.shape[:-1], area)
        areas: Array = area / lens.jacobian_determinant(points / self.focal_length)
        return areas

    def _pixel_sides(self) -> Array:
        return np.array([self.pixel_size, self.pixel_size / self.pixel_aspect])

    def _shows(self, features: Array) -> bool:
        """Whether the lens shows a point within the image, and the point is the one that is shown there."""
        assert self.image_size is not None
        column, row = self.to_image(features[:2]).tolist()
        width, height = self.image_size
        return bool(-0.5 <= column <= width - 0.5 and -0.5 <= row <= height - 0.5)

    def _middle(self) -> Array:
        """Return the principal point [pixels]."""
        if self.image_size is None:
            return np.zeros(2)
        width, height = self.image_size
        if self.principal_point is None:
            return np.array([0.5 * (width - 1), 0.5 * (height - 1)])
        point = vector("principal_point", self.principal_point, 2)
        if not (0.0 <= point[0] <= width - 1.0 and 0.0 <= point[1] <= height - 1.0):
            raise InvalidArgumentError(
                "principal_point", f"must be in the image of {width} x {height} pixels, but is {point.tolist()}"
            )
        object.__setattr__(self, "principal_point", tuple(point.tolist()))
        return point

    def _find_bounds(self) -> Bounds:
        """Return what of the image plane is in the image. Raises InvalidArgumentError where a lens folds it."""
        if self.field_of_view is None or self.image_size is None:
            half = math.inf if self.field_of_view is None else self.focal_length * math.tan(self.field_of_view / 2.0)
            return Bounds(-half, -half / self.pixel_aspect, half, half / self.pixel_aspect)
        width, height = self.image_size
        columns, rows = (np.linspace(-0.5, side - 0.5, _BORDER_POINTS) for side in (width, height))
        points = self.from_image(np.stack(np.meshgrid(columns, rows), axis=-1))
        if not np.isfinite(points).all():
            raise InvalidArgumentError(
                "distortion",
                f"folds within the image of {width} x {height} pixels: these are no coefficients of a lens",
            )
        return Bounds(*points.min(axis=(0, 1)).tolist(), *points.max(axis=(0, 1)).tolist())


def camera_frame(robot: Robot) -> str:
    """Return the frame that a camera is mounted in when none is named, as ``PinholeCamera`` says."""
    named = robot.camera_frame or robot.tool_frame
    if named is not None:
        return named
    model = robot.model
    known = set(robot.frame_names)
    frames = [frame for frame in model.frames if frame.name in known]
    depth = [len(model.supports[frame.parentJoint]) for frame in frames]
    deepest = max(depth)
    return str([frame for frame, joints in zip(frames, depth, strict=True) if joints == deepest][-1].name)
