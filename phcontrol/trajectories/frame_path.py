"""What the path of a frame is: a desired pose, twist and acceleration at every time."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from phcontrol._validation import Array, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot


class FrameReference(NamedTuple):
    """What a path asks of a frame at one time, in the axes of the world and at the frame's origin.

    Those are Pinocchio's LOCAL_WORLD_ALIGNED. A path that leaves the orientation free has no rotation, and only the
    three linear rows of the twist and of the acceleration.

    Example:
        >>> import numpy as np
        >>> from phcontrol import FrameLine, FrameReference, Pose
        >>> line = FrameLine("hand", Pose(np.zeros(3), np.eye(3)), Pose(np.ones(3), np.eye(3)), travel_time=2.0)
        >>> reference = line.at(2.0)
        >>> type(reference) is FrameReference, reference.position.round(6), reference.twist.shape
        (True, array([1., 1., 1.]), (6,))
    """

    position: Array
    """r_d, shape (3,) [m]."""
    rotation: Array | None
    """R_d, shape (3, 3), from the frame's axes to those of the world; None where the orientation is free."""
    twist: Array
    """ξ_d = (ṙ_d, ω_d), shape (6,) [m/s, rad/s]; (3,) where the orientation is free."""
    acceleration: Array
    """ξ̇_d = (r̈_d, ω̇_d), likewise [m/s², rad/s²]."""


@runtime_checkable
class FramePath(Protocol):
    """A motion of one frame in the world, twice differentiable. Anything with these three members is one.

    ``at`` is a pure function of time, defined for every t; what a path does before it starts and after it ends it says
    itself. It asks for an orientation at every time, or at none.

    Example:
        >>> import numpy as np
        >>> from phcontrol import FrameLine, FramePath, Pose
        >>> line = FrameLine("hand", Pose(np.zeros(3), np.eye(3)), Pose(np.ones(3), np.eye(3)), travel_time=2.0)
        >>> isinstance(line, FramePath), line.frame, line.duration
        (True, 'hand', 2.0)
    """

    @property
    def frame(self) -> str:
        """Name of the link or frame that shall move."""
        ...

    @property
    def duration(self) -> float:
        """When the motion has ended, or the length of one period if it never does [s]."""
        ...

    def at(self, t: float) -> FrameReference:
        """Return pose, twist and acceleration at time t [s]."""
        ...


def frame_name(value: str) -> str:
    """Return the name of a frame; whether there is one of that name the robot says."""
    if not isinstance(value, str) or not value:
        raise InvalidArgumentError("frame", f"must be the name of a frame, but is {value!r}")
    return value


def check_frame_path(name: str, value: FramePath, robot: Robot | None = None) -> FramePath:
    """Return ``value`` when it is the path of a frame, with finite values and a rotation at its start and end.

    With a ``robot`` the frame must be one of it, and it must have a joint for each row of the twist.
    """
    if not isinstance(value, FramePath):
        raise InvalidArgumentError(
            name, f"must be the path of a frame (frame, duration, at), but is {type(value).__name__}"
        )
    references = [value.at(t) for t in (0.0, number("duration", value.duration, minimum=0.0))]
    for t, reference in zip((0.0, value.duration), references, strict=True):
        if not isinstance(reference, FrameReference):
            kind = type(reference).__name__
            raise InvalidArgumentError(name, f"must give a FrameReference at {t:g} s, but gives {kind}")
        rows = 3 if references[0].rotation is None else 6
        shapes = {"position": (3,), "rotation": (3, 3), "twist": (rows,), "acceleration": (rows,)}
        if rows == 3 and reference.rotation is None:
            del shapes["rotation"]
        for quantity, shape in shapes.items():
            array = getattr(reference, quantity)
            is_array = isinstance(array, np.ndarray) and array.dtype == np.float64 and array.shape == shape
            if not is_array or not np.isfinite(array).all():
                message = f"must give finite numbers of shape {shape}, but its {quantity} at {t:g} s is {array}"
                raise InvalidArgumentError(name, message)
        turn = reference.rotation
        if turn is not None and (np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0.0):
            raise InvalidArgumentError(name, f"must give rotation matrices, but at {t:g} s gives\n{turn}")
    if robot is not None:
        robot.frame_id(value.frame)
        if robot.n < rows:
            asked = "a position takes 3 joints" if rows == 3 else "a pose takes 6 joints, a position alone 3"
            raise InvalidArgumentError(name, f"asks for more than {robot.name} can do with {robot.n} joints: {asked}")
    return value
