"""The ways that a computation goes through its branches, each traced once, at a sample that takes it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol, TypeVar

import casadi
import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.eigenvalues import written_out
from phcontrol.compilation.errors import CompilationError, NotTraceableError
from phcontrol.compilation.symbol import Guards, Symbol, SymbolArray, symbols

VARIANTS = 8
"""How many ways through its branches are compiled at most; where it takes another, what is interpreted answers."""


class Way(Protocol):
    """One way through a computation."""

    @property
    def guards(self) -> list[Any]:
        """Expressions that are all 1 where it is the way."""
        ...


AnyWay = TypeVar("AnyWay", bound=Way)


class Entries:
    """Symbols for the inputs of a trace, which carry the values of its sample.

    Args:
        inputs: vectors of ``casadi.SX``, the last of them the numbers.
        values: of each.
        guards: where branches leave their conditions.
    """

    def __init__(self, inputs: list[Any], values: list[Array], guards: Guards) -> None:
        self._inputs, self._values, self._guards = inputs, values, guards
        self._numbers, self._taken = self.of(len(inputs) - 1), 0

    def of(self, which: int) -> SymbolArray:
        """Return the symbols of an input."""
        vector, values = self._inputs[which], self._values[which]
        parts = casadi.vertsplit(vector) if vector.numel() else []
        return symbols([Symbol(one, float(value), self._guards) for one, value in zip(parts, values, strict=True)])

    def make(self, found: list[float]) -> list[Any]:
        """Return symbols for the next numbers, in their order, whatever ``found`` holds."""
        self._taken += len(found)
        if self._taken > len(self._numbers):
            raise NotTraceableError("it changes while it is evaluated")
        return list(self._numbers[self._taken - len(found) : self._taken])


def guarded_ways(
    name: str, inputs: list[Any], samples: Iterable[list[Array]], traced: Callable[[list[Array]], AnyWay]
) -> list[AnyWay]:
    """Return the ways that are taken at some samples, at most ``VARIANTS``.

    Raises NotTraceableError, naming the line, where it cannot be traced at any of them.
    """
    ways: list[AnyWay] = []
    covers: list[Any] = []
    failure: CompilationError | None = None
    for values in samples:
        if len(ways) == VARIANTS or any(_holds(cover, values) for cover in covers):
            continue
        try:
            way = traced(values)
        except NotTraceableError as error:
            failure = error
            continue
        cover = casadi.Function("guards", inputs, [written_out(casadi.vertcat(casadi.SX(1), *way.guards))])
        if not _holds(cover, values):  # a quotient or a root that is no number there
            failure = NotTraceableError(f"{name} cannot be compiled: it computes what is not finite on its way")
            continue
        ways.append(way)
        covers.append(cover)
    if not ways:
        raise failure or CompilationError(f"{name} could not be evaluated at any state, and so not be traced")
    return ways


def _holds(cover: Any, values: list[Array]) -> bool:
    return bool(np.array(cover(*values)).all())
