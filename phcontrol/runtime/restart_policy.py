"""When a loop that stopped by itself starts again: later each time, and not for ever."""

from __future__ import annotations

_RECOVERY_TIME = 0.1  # of good readings before the first restart [s]
_MOST_STOPS = 5  # that running did not make up for
_FORGETTING_TIME = 10.0  # of running by which one stop is forgotten [s]
_LONGEST_WAIT = 10.0  # for good readings; an arm must not start to move long after it stopped [s]


class RestartPolicy:
    """Decides when to start again after stops that may pass by themselves (stale readings, gaps, missed deadlines).

    The first restart waits for 0.1 s of good readings, each further one twice as long as the one before. Running for
    10 s makes up for one stop. It gives up when more than five stops are not made up for, or when good readings do not
    come within 10 s and the time to wait for.

    Args:
        period: of the loop [s].
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self.reset()

    def reset(self) -> None:
        """Forget all stops."""
        self._stops, self._since_none = 0.0, 0
        self._good_time = self._waited = 0.0

    @property
    def recovery_time(self) -> float:
        """How long readings must have been good before the next restart [s]."""
        return float(_RECOVERY_TIME * 2.0 ** max(0.0, self._stops - 1.0))

    def note_running(self) -> None:
        """Note a period in which the law acted."""
        self._stops = max(0.0, self._stops - self._period / _FORGETTING_TIME)
        if self._stops == 0.0:
            self._since_none = 0

    def note_stop(self) -> str:
        """Note a stop; return why there will be no restart, empty if there may be one."""
        self._stops += 1.0
        self._since_none += 1
        self._good_time = self._waited = 0.0
        return f"gave up after {self._since_none} stops" if self._stops > _MOST_STOPS else ""

    def note_waiting(self, good: bool, elapsed: float) -> None:
        """Note a step after a stop, its reading good or not, and the time since the step before [s]."""
        self._good_time = self._good_time + self._period if good else 0.0
        self._waited += elapsed

    @property
    def is_ready(self) -> bool:
        """Whether to start again."""
        return self._good_time >= self.recovery_time - 0.5 * self._period

    @property
    def complaint(self) -> str:
        """Why to wait no longer, empty otherwise."""
        if self._waited <= _LONGEST_WAIT + self.recovery_time:
            return ""
        return f"gave up: not {self.recovery_time:.2g} s of good readings in {self._waited:.3g} s"
