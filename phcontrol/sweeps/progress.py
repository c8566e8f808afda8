"""How far a sweep is, and how long it will still take."""

from __future__ import annotations

from types import TracebackType

from tqdm import tqdm


class Progress:
    """A bar of runs: done, failed, runs per second and the time left (from the rate of this call alone).

    Args:
        total: runs of the sweep.
        done: runs that are there already.
        shown: True or False; None for only on a terminal.
    """

    def __init__(self, total: int, done: int, shown: bool | None) -> None:
        disable = None if shown is None else not shown
        self._bar = tqdm(total=total, initial=done, unit="run", disable=disable, smoothing=0.1, leave=False)
        self._failed = 0

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def advance(self, runs: int, failed: int) -> None:
        """Count runs that are done, and those of them that failed."""
        self._failed += failed
        if self._failed:
            self._bar.set_postfix_str(f"{self._failed} failed", refresh=False)
        self._bar.update(runs)
