"""The largest bandwidth with which something holds."""

from __future__ import annotations

import math
from collections.abc import Callable

FIRST = 0.5
"""Smallest bandwidth that is looked at [rad/s]."""
_FACTOR, _HALVINGS = 1.4, 8


def largest_bandwidth(holds: Callable[[float], bool], last: float) -> float:
    """Return the largest ω with which it holds, looked for from ``last`` down in steps of 40 % and bisected [rad/s].

    To 0.2 %; 0 if it does not hold anywhere down to 0.5 rad/s.
    """
    high = low = last
    while not holds(low):
        high, low = low, low / _FACTOR
        if low < FIRST:
            return 0.0
    if low == last:
        return last
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
