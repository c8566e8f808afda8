"""Timing of a control loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phcontrol.runtime.duration_histogram import DurationHistogram


@dataclass(frozen=True)
class Timing:
    """Figures of a loop's timing [s], over all its steps: numbers and extremes exactly, percentiles within 0.5 %."""

    steps: int
    """How many steps there were."""
    p50: float
    """Median of the time that a step computed."""
    p99: float
    """99th percentile of it."""
    p99_9: float
    """99.9th percentile of it."""
    longest: float
    """The longest step."""
    misses: int
    """Periods without a torque in time: steps that computed for longer than the deadline, and skipped periods."""
    skipped: int
    """Periods without a step."""
    interval_p50: float
    """Median of the time from one step to the next."""
    interval_p99_9: float
    """99.9th percentile of it."""
    interval_longest: float
    """The longest pause from one step to the next."""

    def __str__(self) -> str:
        return (
            f"{self.steps} steps: computing {1e6 * self.p50:.0f} µs median, {1e6 * self.p99:.0f} µs p99, "
            f"{1e6 * self.p99_9:.0f} µs p99.9 (each within 0.5 %), {1e6 * self.longest:.0f} µs at most; "
            f"{self.misses} periods missed, {self.skipped} of them skipped; "
            f"interval {1e3 * self.interval_p50:.3f} ms median, {1e3 * self.interval_p99_9:.3f} ms p99.9, "
            f"{1e3 * self.interval_longest:.3f} ms at most"
        )


class TimingRecorder:
    """Keeps the figures of a loop's steps in memory that does not grow, and notices periods without a step.

    Steps are due one period after each other. One that is late by a whole period or more skipped periods; one that is
    early, or late by more, moves what is due after it.

    Args:
        period: of the loop [s].
        deadline: of one step's computation [s].
    """

    def __init__(self, period: float, deadline: float) -> None:
        self._period, self._deadline = period, deadline
        self._computing, self._intervals = DurationHistogram(), DurationHistogram()
        self._skipped = self._overruns = 0
        self._last: float | None = None
        self._due = 0.0
        self._skipped_now = 0
        self.last = 0.0
        """How long the last step computed [s]."""

    def begin(self, now: float, elapsed: float | None = None) -> float:
        """Note the begin of a step at a time [s]; return the time since the last begin, a period for the first [s].

        Where the arm says what has ``elapsed`` by its own clock since its reading before, that is what passed, and
        counts for skipped periods; the intervals are by this clock all the same.
        """
        last, self._last = self._last, now
        if last is None:
            self._due = now + self._period
            return self._period
        self._intervals.add(now - last)
        if elapsed is not None:
            self._skipped_now = max(0, round(elapsed / self._period) - 1)
            self._skipped += self._skipped_now
            self._due = now + self._period
            return elapsed
        skipped = self._skipped_now = max(0, math.floor((now - self._due) / self._period + 1e-6))
        self._skipped += skipped
        self._due = min(now, self._due + skipped * self._period) + self._period
        return now - last

    def end(self, now: float) -> int:
        """Note the end of a step at a time [s]; return the periods missed with it: skipped before it, and its own."""
        assert self._last is not None
        computing = self.last = now - self._last
        self._computing.add(computing)
        overran = computing > self._deadline
        self._overruns += overran
        return self._skipped_now + overran

    @property
    def timing(self) -> Timing:
        """The figures."""
        computing, intervals = self._computing, self._intervals
        return Timing(
            computing.count,
            computing.percentile(50.0),
            computing.percentile(99.0),
            computing.percentile(99.9),
            computing.longest,
            self._overruns + self._skipped,
            self._skipped,
            intervals.percentile(50.0),
            intervals.percentile(99.9),
            intervals.longest,
        )
