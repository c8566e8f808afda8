"""The same path of a frame, slower."""

from __future__ import annotations

from phcontrol._validation import positive
from phcontrol.trajectories.frame_path import FramePath, FrameReference, check_frame_path


class SlowedPath:
    """A path on which the time runs slower: the pose at t is that of the path at t/κ.

    The twist is divided by κ, its derivative by κ². ``within_limits`` finds κ.

    Args:
        path: of a frame.
        factor: κ > 0; below 1 it is faster.

    Example:
        >>> import numpy as np
        >>> from phcontrol import FrameLine, Pose, SlowedPath
        >>> line = FrameLine("hand", Pose(np.zeros(3), np.eye(3)), Pose(np.ones(3), np.eye(3)), travel_time=2.0)
        >>> slow = SlowedPath(line, 2.0)
        >>> slow.duration, np.allclose(slow.at(2.0).position, line.at(1.0).position)
        (4.0, True)
    """

    def __init__(self, path: FramePath, factor: float) -> None:
        self.path = check_frame_path("path", path)
        self.factor = positive("factor", factor)

    @property
    def frame(self) -> str:
        """Name of the link or frame that moves."""
        return self.path.frame

    @property
    def duration(self) -> float:
        """When the motion has ended, or the length of one period if it never does [s]."""
        return self.path.duration * self.factor

    def at(self, t: float) -> FrameReference:
        """Return pose, twist and acceleration at time t [s]."""
        position, turn, twist, acceleration = self.path.at(t / self.factor)
        return FrameReference(position, turn, twist / self.factor, acceleration / self.factor**2)
