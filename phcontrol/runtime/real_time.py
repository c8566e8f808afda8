"""What a program can ask its computer for, so that a control loop is on time."""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import NamedTuple

from phcontrol._validation import count, flag, sequence
from phcontrol.exceptions import InvalidArgumentError

_EVERYTHING, _FUTURE = 1, 2  # MCL_CURRENT and MCL_FUTURE of <sys/mman.h> on Linux


class Effect(NamedTuple):
    """What became of one wish."""

    name: str
    took_effect: bool
    detail: str
    """What holds now, or why not."""

    def __str__(self) -> str:
        return f"{self.name}: {'' if self.took_effect else 'NOT in effect, '}{self.detail}"


class RealTime:
    """Asks for what keeps a control loop on time, says of each wish whether it took effect, and gives it back.

        with RealTime(priority=80, lock_memory=True, cores=[3], freeze_gc=True) as real_time:
            print(real_time)
            drive(loop, arm, 10.0)

    Nothing is an error that the computer refuses: look at ``effects``, or ``all_took_effect``. What was in effect is
    looked up after asking, not taken for granted. Enter it in the thread that runs the loop.

    Args:
        priority: 1 to 99 of the real-time scheduler SCHED_FIFO, under which nothing but the kernel and programs of
            higher priority interrupts the loop; a loop that never waits then starves its core. None leaves it.
        lock_memory: keep all pages of the process in memory, present and future ones.
        cores: what it may run on, best one that the kernel leaves alone (isolcpus); None leaves it.
        freeze_gc: take all objects there are out of Python's garbage collection, after a last one: a later collection
            looks at what came since only.

    Example:
        >>> from phcontrol import RealTime
        >>> with RealTime() as asked:  # asks for nothing
        ...     print(asked.all_took_effect)
        True
    """

    def __init__(
        self,
        *,
        priority: int | None = None,
        lock_memory: bool = False,
        cores: Sequence[int] | None = None,
        freeze_gc: bool = False,
    ) -> None:
        if priority is not None and count("priority", priority) > 99:
            raise InvalidArgumentError("priority", f"must be 1 to 99, but is {priority}")
        self._priority, self._lock = priority, flag("lock_memory", lock_memory)
        self._cores = (
            None if cores is None else {count("cores", core, minimum=0) for core in sequence("cores", cores, "numbers")}
        )
        if self._cores is not None and not self._cores:
            raise InvalidArgumentError("cores", "must name one core at least")
        self._freeze = flag("freeze_gc", freeze_gc)
        self.effects: list[Effect] = []
        """What became of each wish."""
        self._undo: list[Callable[[], object]] = []

    def __str__(self) -> str:
        return "\n".join(map(str, self.effects)) or "nothing was asked for"

    @property
    def all_took_effect(self) -> bool:
        """Whether all that was asked for is in effect."""
        return all(effect.took_effect for effect in self.effects)

    def __enter__(self) -> RealTime:
        self.effects = []
        if self._freeze:
            self._freeze_gc()
        if self._cores is not None:
            self._ask("cores", lambda: self._take_cores(self._cores or set()))
        if self._lock:
            self._ask("memory", self._lock_memory)
        if self._priority is not None:
            self._ask("priority", lambda: self._take_priority(self._priority or 1))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        while self._undo:
            self._undo.pop()()

    def _ask(self, name: str, wish: Callable[[], str]) -> None:
        """Note what became of a wish."""
        try:
            self.effects.append(Effect(name, True, wish()))
        except (OSError, AttributeError) as error:  # refused, or unknown to this system
            reason = "unknown to this system" if isinstance(error, AttributeError) else os.strerror(error.errno or 0)
            self.effects.append(Effect(name, False, reason.lower()))

    def _take_priority(self, priority: int) -> str:
        policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        self._undo.append(lambda: os.sched_setscheduler(0, policy, parameters))
        if os.sched_getscheduler(0) != os.SCHED_FIFO or os.sched_getparam(0).sched_priority != priority:
            raise OSError(1, "refused")
        return f"SCHED_FIFO {priority}"

    def _take_cores(self, cores: set[int]) -> str:
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, cores)
        self._undo.append(lambda: os.sched_setaffinity(0, before))
        if os.sched_getaffinity(0) != cores:
            raise OSError(22, "refused")
        return f"{sorted(cores)} of {sorted(before)}"

    def _lock_memory(self) -> str:
        library = ctypes.CDLL(None, use_errno=True)
        if library.mlockall(_EVERYTHING | _FUTURE) != 0:
            raise OSError(ctypes.get_errno(), "refused")
        self._undo.append(library.munlockall)
        locked = locked_memory()
        if locked == 0:
            raise OSError(12, "refused")
        return f"{locked / 1e6:.0f} MB locked"

    def _freeze_gc(self) -> None:
        gc.collect()
        gc.freeze()
        self._undo.append(gc.unfreeze)
        frozen = gc.get_freeze_count()
        self.effects.append(Effect("garbage collection", frozen > 0, f"{frozen} objects left out"))


def locked_memory() -> int:
    """Return how much of this process's memory is locked [bytes]."""
    with open("/proc/self/status", encoding="ascii", errors="replace") as status:
        line = next((line for line in status if line.startswith("VmLck:")), "VmLck: 0")
    return 1024 * int(line.split()[1])
