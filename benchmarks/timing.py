"""Interleaved timing: every candidate is timed in every round, so that the machine's moods hit all alike."""

from __future__ import annotations

import contextlib
import gc
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Timing:
    """Times of single calls of one candidate [µs]."""

    name: str
    microseconds: np.ndarray

    @property
    def median(self) -> float:
        """Median over all calls [µs]."""
        return float(np.median(self.microseconds))

    @property
    def p99(self) -> float:
        """99th percentile over all calls [µs]."""
        return float(np.percentile(self.microseconds, 99))

    @property
    def spread(self) -> float:
        """Interquartile range over all calls, relative to the median."""
        low, high = np.percentile(self.microseconds, [25, 75])
        return float((high - low) / self.median)


def interleaved(candidates: dict[str, Callable[[], object]], rounds: int = 200, calls: int = 20) -> dict[str, Timing]:
    """Time each candidate ``calls`` times in each of ``rounds`` rounds, after a warm-up."""
    for function in candidates.values():
        for _ in range(200):
            function()
    times = {name: np.empty((rounds, calls)) for name in candidates}
    clock = time.perf_counter_ns
    gc.collect()
    gc.disable()
    try:
        for row in range(rounds):
            for name, function in candidates.items():
                cells = times[name][row]
                for column in range(calls):
                    start = clock()
                    function()
                    cells[column] = clock() - start
    finally:
        gc.enable()
    overhead = float(np.median([-(clock() - clock()) for _ in range(1000)]))
    return {name: Timing(name, (cells.ravel() - overhead) / 1e3) for name, cells in times.items()}


@contextlib.contextmanager
def on_cores(count: int) -> Iterator[None]:
    """Hold what runs inside, and processes that it starts, to so many cores, where the system lets a process choose."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(allowed)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
