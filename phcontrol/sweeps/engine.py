"""What carries tasks to processors: one small interface."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import Any, NamedTuple, Protocol

from phcontrol.exceptions import PHControlError


class EngineError(PHControlError):
    """No processor took a task: a scheduler that is not there, a process that was killed, another phcontrol."""


class Finished(NamedTuple):
    """A task that came to its end."""

    item: Any
    """What it was given."""
    value: Any
    """What it returned; None where it raised."""
    error: Exception | None
    """What it raised; an EngineError where it ended without an answer (killed, out of memory). None for nothing."""


class Engine(Protocol):
    """Carries out a task for many items, in any order."""

    workers: int
    """How many tasks run at a time."""

    def run(self, task: Callable[[Any], Any], items: Iterable[Any]) -> Generator[Finished, None, None]:
        """Yield what came of ``task(item)`` of each item, as they finish.

        ``task`` is a function of a module that can be imported there; items are taken as they are needed. When the
        iterator is closed early, tasks that have not begun are left out, and those that run are stopped.
        """
        ...
