"""The worst that was found, and where."""

from __future__ import annotations

import math
from collections.abc import Iterable
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
