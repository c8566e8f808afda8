"""The last check before a torque leaves."""

from __future__ import annotations

from typing import Any

import numpy as np

from phcontrol._validation import Array, real_array
from phcontrol.safety.clipping import clipped


class TorqueGate:
    """Lets torques leave that are real and finite, clipped to effort and rate, whoever made them.

    After the torque filter nothing is left to clip; the gate does not rely on that.

    Args:
        effort: |u| ≤ effort, infinite for no limit, shape (n,) [N·m].
        step: |u − u_previous| ≤ step, infinite for no limit, shape (n,) [N·m].
    """

    def __init__(self, effort: Array, step: Array) -> None:
        self._effort, self._step = effort, step
        self.previous: Array | None = None
        """The last torque that left, read-only; None before the first."""

    def passed(self, torque: Any) -> Array | None:
        """Return the torque that may leave, read-only; None for one that is not n finite real numbers."""
        array = real_array(torque, self._effort.shape)
        if array is None:
            return None
        low, high = -self._effort, self._effort
        if self.previous is not None:
            low, high = np.maximum(self.previous - self._step, low), np.minimum(self.previous + self._step, high)
        leaving = clipped(array, low, high)
        leaving.flags.writeable = False
        self.previous = leaving
        return leaving
