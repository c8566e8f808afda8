"""The worst that was found, and where."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple


class Worst(NamedTuple):
    """The largest figure and where it was found."""

    value: float
    where: str

    @classmethod
    def of(cls, found: Iterable[tuple[float, str]], lowest: float = 0.0) -> Worst:
        """Return the first of the largest figures above ``lowest``; NaN counts as infinite."""
        worst = cls(lowest, "")
        for value, where in found:
            if not value <= worst.value:
                worst = cls(math.inf if math.isnan(value) else float(value), where)
        return worst

    @classmethod
    def among(cls, values: Sequence[float], described: Callable[[int], str], lowest: float = 0.0) -> Worst:
        """Return the same of some values, of which the place of the k-th is ``described(k)``: asked for one alone."""
        value, worst = lowest, -1
        for k, each in enumerate(values):
            if not each <= value:
                value, worst = math.inf if math.isnan(each) else float(each), k
        return cls(value, described(worst) if worst >= 0 else "")
