"""Timing of a control loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phcontrol._validation import Array

_KEPT = 200_000


@dataclass(frozen=True)
class Timing:
    """Figures of a loop's timing [s], over its last 200 000 steps."""

    steps: int
    """How many steps there were altogether."""
    p50: float
    """Median of the time that a step computed."""
    p99: float
    """99th percentile of it."""
    p99_9: float
    """99.9th percentile of it."""
    longest: float
    """The longest step."""
    misses: int
    """Steps that computed for longer than the deadline."""
    interval_p50: float
    """Median of the time from one step to the next."""
    interval_p99_9: float
    """99.9th percentile of it."""
    interval_longest: float
    """The longest pause from one step to the next."""

    def __str__(self) -> str:
        return (
            f"{self.steps} steps: computing {1e6 * self.p50:.0f} µs median, {1e6 * self.p99:.0f} µs p99, "
            f"{1e6 * self.p99_9:.0f} µs p99.9, {1e6 * self.longest:.0f} µs at most, {self.misses} deadlines missed; "
            f"interval {1e3 * self.interval_p50:.3f} ms median, {1e3 * self.interval_p99_9:.3f} ms p99.9, "
            f"{1e3 * self.interval_longest:.3f} ms at most"
        )


class TimingRecorder:
    """Keeps begin and end of the last steps in memory that is made once."""

    def __init__(self) -> None:
        self._begin, self._end = np.zeros(_KEPT), np.zeros(_KEPT)
        self._count = 0

    def record(self, begin: float, end: float) -> None:
        """Note one step."""
        place = self._count % _KEPT
        self._begin[place], self._end[place] = begin, end
        self._count += 1

    def timing(self, deadline: float) -> Timing:
        """Return the figures."""
        kept = min(self._count, _KEPT)
        if kept == 0:
            return Timing(0, 0.0, 0.0, 0.0, 0.0, 0, 0.0, 0.0, 0.0)
        order = np.arange(self._count - kept, self._count) % _KEPT
        begin = self._begin[order]
        computing = self._end[order] - begin
        intervals: Array = np.diff(begin) if kept > 1 else np.zeros(1)
        p50, p99, p99_9, longest = np.percentile(computing, [50.0, 99.0, 99.9, 100.0]).tolist()
        between = np.percentile(intervals, [50.0, 99.9, 100.0]).tolist()
        return Timing(self._count, p50, p99, p99_9, longest, int((computing > deadline).sum()), *between)
