"""The largest bandwidth up to which something holds."""

from __future__ import annotations

import math
from collections.abc import Callable

FIRST, LAST = 0.25, 400.0
"""Bandwidths that are looked through [rad/s]."""
_FACTOR, _HALVINGS = 1.3, 9


def largest_bandwidth(holds: Callable[[float], bool], first: float = FIRST, last: float = LAST) -> float:
    """Return the largest ω up to which it holds, looked for in steps of 30 % and bisected to 0.1 % [rad/s].

    0 if it does not hold at ``first``; ``last`` if it holds everywhere.
    """
    if not holds(first):
        return 0.0
    low = first
    while low < last:
        high = min(_FACTOR * low, last)
        if not holds(high):
            for _ in range(_HALVINGS):
                middle = math.sqrt(low * high)
                low, high = (middle, high) if holds(middle) else (low, middle)
            return low
        low = high
    return last
