"""The last check before a torque leaves."""

from __future__ import annotations

from typing import Any

from phcontrol._validation import Array, real_array
from phcontrol.safety.clipping import clipped
from phcontrol.safety.torque_range import RobotShare, torque_range


class TorqueGate:
    """Lets torques leave that are real and finite, clipped to effort and rate, whoever made them.

    Both hold for what the motors carry and, where the robot adds its own part, for what is sent
    (:func:`torque_range`). After the torque filter nothing is left to clip; the gate does not rely on that.

    Args:
        effort: |u| ≤ effort, infinite for no limit, shape (n,) [N·m].
        step: |u − u_previous| ≤ step, infinite for no limit, shape (n,) [N·m].
    """

    def __init__(self, effort: Array, step: Array) -> None:
        self._effort, self._step = effort, step
        self.previous: Array | None = None
        """What the motors carried last, read-only; None before the first."""

    def passed(self, torque: Any, share: RobotShare | None = None) -> Array | None:
        """Return the torque that the motors may carry, read-only; None for one that is not n finite real numbers."""
        array = real_array(torque, self._effort.shape)
        if array is None:
            return None
        leaving = clipped(array, *torque_range(self._effort, self._step, self.previous, share))
        leaving.flags.writeable = False
        self.previous = leaving
        return leaving

    def sent(self, torque: Array, share: RobotShare | None) -> Array:
        """Return a copy of what is sent so that the motors carry a torque, never beyond the effort by rounding."""
        return torque.copy() if share is None else clipped(torque - share.now, -self._effort, self._effort)
