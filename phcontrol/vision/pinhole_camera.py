"""A pinhole camera in the hand of an arm."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, count, finite_array, number, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera: z of its frame is the optical axis, x points right in the image and y down.

    A point (X, Y, Z) in the camera's frame falls on (μ, ν) = (f/Z)(X, Y) of the image plane [m].

    Args:
        focal_length: f [m].
        frame: the frame of the arm that is the camera's; None for the robot's camera frame, or where it has none
            its tool frame, or else the last frame of the longest chain of joints.
        image_size: width and height [pixels]; None for a camera of which no images are made.
        field_of_view: horizontal angle that the image covers [rad]; None for an image plane without end, as the
            thesis's (then there are no pixels either). The vertical one follows from ``image_size``.
    """

    focal_length: float = 0.01
    frame: str | None = None
    image_size: tuple[int, int] | None = None
    field_of_view: float | None = None

    def __post_init__(self) -> None:
        positive("focal_length", self.focal_length)
        if self.field_of_view is not None:
            number("field_of_view", self.field_of_view, minimum=0.0, exclusive=True, maximum=math.pi - 1e-3)
        if self.image_size is not None:
            if len(self.image_size) != 2:
                raise InvalidArgumentError("image_size", f"must be (width, height), but is {self.image_size!r}")
            for side in self.image_size:
                count("image_size", side, minimum=8)
            if self.field_of_view is None:
                raise InvalidArgumentError("field_of_view", "is needed for images: how wide they are [rad]")
        half_width = math.inf if self.field_of_view is None else self.focal_length * math.tan(self.field_of_view / 2.0)
        width, height = self.image_size or (1, 1)
        object.__setattr__(self, "_half_size", (half_width, half_width * height / width))

    def mounted_on(self, robot: Robot, frame: str | None = None) -> PinholeCamera:
        """Return the camera with its frame named: ``frame``, else its own, else the robot's; it must exist."""
        name = frame or self.frame or camera_frame(robot)
        robot.frame_id(name)
        return replace(self, frame=name)

    @property
    def half_size(self) -> tuple[float, float]:
        """Half the width and height of the image [m]; infinite without a field of view."""
        half: tuple[float, float] = self.__dict__["_half_size"]
        return half

    def sees(self, features: Array) -> bool:
        """Whether features (μ, ν, l) are those of an object in front of the camera and in its image."""
        mu, nu, size = features.tolist()
        half_width, half_height = self.half_size
        return bool(0.0 < size < math.inf and abs(mu) <= half_width and abs(nu) <= half_height)

    def why_not_seen(self, features: Array) -> str:
        """Return in words why an object with these features is not seen; empty if it is."""
        mu, nu, size = features.tolist()
        if math.isnan(mu + nu + size):
            return "no object is found in the image"
        if not 0.0 < size < math.inf:
            return f"it is not in front of the camera (length {size:g} m in the image, so a depth Z <= 0)"
        if self.sees(features):
            return ""
        half_width, half_height = self.half_size
        return f"it has left the image: ({mu:g}, {nu:g}) m is outside ±({half_width:g}, {half_height:g}) m"

    # --- pixels -----------------------------------------------------------------------------------

    @property
    def pixel_size(self) -> float:
        """Width of a (square) pixel on the image plane [m]. Raises InvalidArgumentError without an image."""
        if self.image_size is None:
            raise InvalidArgumentError("image_size", "this camera has no pixels: give image_size and field_of_view")
        return 2.0 * self.half_size[0] / self.image_size[0]

    def to_pixels(self, features: ArrayLike) -> Array:
        """Return (column, row, length) in pixels; (0, 0) is the centre of the first pixel."""
        width, height = self.image_size or (0, 0)
        middle = np.array([0.5 * (width - 1), 0.5 * (height - 1), 0.0])
        pixels: Array = finite_array("features", features) / self.pixel_size + middle
        return pixels

    def from_pixels(self, pixels: ArrayLike) -> Array:
        """Return the features (μ, ν, l) [m] of (column, row, length) in pixels: the inverse of ``to_pixels``."""
        width, height = self.image_size or (0, 0)
        centred = finite_array("pixels", pixels) - np.array([0.5 * (width - 1), 0.5 * (height - 1), 0.0])
        features: Array = centred * self.pixel_size
        return features


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
