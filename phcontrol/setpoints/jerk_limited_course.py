"""Numbers on their fastest way within limits, redirected at any time."""

from __future__ import annotations

from bisect import bisect_left
from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array, positive
from phcontrol.exceptions import PHControlError


class Limits(NamedTuple):
    """How fast each number may change."""

    speed: Array
    acceleration: Array
    jerk: Array

    @classmethod
    def of(cls, speed: Array, acceleration: float | None, jerk: float | None) -> Limits:
        """Return limits of which acceleration and jerk are given over the speed [1/s, 1/s²]; by default 4 and 40."""
        by_time = 4.0 if acceleration is None else positive("acceleration", acceleration)
        twice = 10.0 * by_time if jerk is None else positive("jerk", jerk)
        return cls(speed, by_time * speed, twice * speed)


class Moment(NamedTuple):
    """Where a course is at one time."""

    leg: int
    """Number of the last redirection; −1 before the first."""
    position: Array
    velocity: Array
    acceleration: Array


class JerkLimitedCourse:
    """The fastest motion within limits on speed, acceleration and jerk, from wherever it is to the last goal.

    All numbers arrive together, on a straight way where that is no slower. Computed by Ruckig (L. Berscheid and
    T. Kröger, "Jerk-limited real-time trajectory generation with arbitrary target states", RSS 2021).

    Args:
        origin: numbers at first.
        limits: of each.

    Raises PHControlError where Ruckig is not installed.
    """

    def __init__(self, origin: Array, limits: Limits) -> None:
        self._ruckig = _load_ruckig()
        self._origin, size = origin, origin.size
        self._generator, self._input = self._ruckig.Ruckig(size), self._ruckig.InputParameter(size)
        for name, limit in zip(("max_velocity", "max_acceleration", "max_jerk"), limits, strict=True):
            setattr(self._input, name, limit.tolist())
        self._input.synchronization = self._ruckig.Synchronization.Phase
        self._starts: list[float] = []
        self._legs: list[tuple[Any, Array]] = []

    @property
    def end(self) -> float:
        """When it stands at its goal [s]; 0 before the first."""
        return self._starts[-1] + self._legs[-1][0].duration if self._starts else 0.0

    def redirect(self, t: float, position: Array, velocity: Array, acceleration: Array, goal: Array) -> None:
        """Go on from a state at time t to a goal [s]. Raises PHControlError when there is no such motion."""
        given, leg = self._input, self._ruckig.Trajectory(position.size)
        given.current_position, given.target_position = position.tolist(), goal.tolist()
        given.current_velocity, given.current_acceleration = velocity.tolist(), acceleration.tolist()
        try:
            result = self._generator.calculate(given, leg)
        except (self._ruckig.RuckigError, ValueError) as error:
            raise PHControlError(f"there is no motion within the limits to {goal}: {error}") from error
        if result not in (self._ruckig.Result.Working, self._ruckig.Result.Finished):
            raise PHControlError(f"there is no motion within the limits to {goal}: {result}")
        self._legs.append((leg, goal))
        self._starts.append(t)  # last: a reader on another thread goes by this

    def at(self, t: float) -> Moment:
        """Return where it is at time t [s]."""
        leg = bisect_left(self._starts, t) - 1  # where two meet, the one that was there before: it stays what it was
        motion, goal = self._legs[leg] if leg >= 0 else (None, self._origin)
        if motion is None or t - self._starts[leg] >= motion.duration:
            return Moment(leg, np.array(goal), np.zeros(goal.size), np.zeros(goal.size))
        return Moment(leg, *map(np.array, motion.at_time(t - self._starts[leg])))


def _load_ruckig() -> Any:
    """Return the module ruckig, loaded when it is used. Raises PHControlError, saying how to install it."""
    try:
        import ruckig
    except ImportError as error:
        raise PHControlError("live goals need Ruckig: pip install 'phcontrol[live]'") from error
    return ruckig
