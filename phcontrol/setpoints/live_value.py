"""Numbers that may be changed while an arm runs."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.setpoints.live_motion import LiveMotion
from phcontrol.trajectories.minimum_jerk import PEAK_SPEED, MinimumJerk

_SHORTEST = 0.05  # change [s]


class LiveValue(LiveMotion[Array]):
    """Numbers on a smooth course to those last asked for: a stiffness, a force. Called with a time it returns them.

    One change after the other, from rest to rest (:class:`MinimumJerk`); one that comes meanwhile waits, and a later
    one takes its place. So the course is straight between what was asked for: a stiffness between positive definite
    ones is positive definite.

    Args:
        origin: numbers at first; every change has their shape.
        rate: how fast each may change, in its unit over a second.
        unit: of the numbers, as a page shows it.
        check: called with what is asked for; raises InvalidArgumentError for what must not be.

    Raises:
        InvalidArgumentError: numbers of another shape or not finite; a rate that is not positive.

    Example:
        >>> from phcontrol.setpoints import LiveValue
        >>> stiffness = LiveValue([500.0, 500.0, 200.0], rate=1000.0)
        >>> stiffness.request([800.0, 500.0, 200.0])
        >>> stiffness.advance(0.0)
        >>> stiffness(5.0)
        array([800., 500., 200.])
    """

    def __init__(
        self, origin: ArrayLike, *, rate: float, unit: str = "", check: Callable[[Array], object] | None = None
    ) -> None:
        start = finite_array("origin", origin)
        self.unit, self._check = unit, check
        if check is not None:
            check(start)
        self._rate = positive("rate", rate)
        super().__init__(start)
        self._changes: list[MinimumJerk] = []
        self._starts: list[float] = []

    @property
    def duration(self) -> float:
        """When the course so far ends [s]; 0 before the first change."""
        return self._changes[-1].duration if self._changes else 0.0

    def __call__(self, t: float) -> Array:
        """Return the numbers at time t [s], of the shape of those at first."""
        k = bisect_right(self._starts, self.plain(t)) - 1
        value: Array = np.array(self._origin) if k < 0 else self._changes[k].at(t).position.reshape(self._origin.shape)
        return value

    def checked(self, goal: Any) -> Array:
        """Return a goal as an array. Raises InvalidArgumentError for what it cannot become."""
        value, shape = finite_array("goal", goal), self._origin.shape
        if value.shape != shape:
            raise InvalidArgumentError("goal", f"must have shape {shape}, but has shape {value.shape}")
        if self._check is not None:
            self._check(value)
        return value

    def _is_free(self, t: float) -> bool:
        return t >= self.duration

    def _redirect(self, t: float, goal: Array) -> None:
        before = self(t)
        time = max(_SHORTEST, PEAK_SPEED * float(np.abs(goal - before).max(initial=0.0)) / self._rate)
        self._changes.append(MinimumJerk(before.ravel(), goal.ravel(), time, start=t))
        self._starts.append(t)  # last: a reader on another thread goes by this
