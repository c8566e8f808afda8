"""What carries tasks to processors: one small interface."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import Any, NamedTuple, Protocol

from phcontrol.exceptions import PHControlError


class EngineError(PHControlError):
    """No processor took a task: a scheduler that is not there, a process that was killed, another phcontrol.

    Example:
        >>> from phcontrol import DaskScheduler, EngineError
        >>> try:
        ...     DaskScheduler("tcp://127.0.0.1:1", timeout=0.2)
        ... except EngineError as error:
        ...     print("refused:", str(error)[:25])
        refused: no Dask scheduler answers
    """


class Finished(NamedTuple):
    """A task that came to its end."""

    item: Any
    """What it was given."""
    value: Any
    """What it returned; None where it raised."""
    error: Exception | None
    """What it raised; an EngineError where it ended without an answer (killed, out of memory). None for nothing."""


class Engine(Protocol):
    """Carries out a task for many items, in any order.

    Example:
        >>> from collections import Counter
        >>> from phcontrol import Engine, LocalProcesses
        >>> engine: Engine = LocalProcesses(workers=2)
        >>> sorted(done.value for done in engine.run(len, ["a", "bc", "def"]))
        [1, 2, 3]
    """

    workers: int
    """How many tasks run at a time."""

    def run(self, task: Callable[[Any], Any], items: Iterable[Any]) -> Generator[Finished, None, None]:
        """Yield what came of ``task(item)`` of each item, as they finish.

        ``task`` is a function of a module that can be imported there; items are taken as they are needed. When the
        iterator is closed early, tasks that have not begun are left out, and those that run are stopped.
        """
        ...
