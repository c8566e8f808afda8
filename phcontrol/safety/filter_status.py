"""How the torque filter found a torque."""

from __future__ import annotations

from enum import IntEnum


class FilterStatus(IntEnum):
    """How a torque was found."""

    PASSED = 0
    """The law's torque, unchanged."""
    CLIPPED = 1
    """Its projection on effort and rate limits, in closed form; nothing else was in the way."""
    SOLVED = 2
    """The program's answer: every condition is met."""
    FEASIBLE = 3
    """Every condition is met, but the solver failed and a nearer torque may exist: the best of a search."""
    STORAGE_RELAXED = 4
    """The program's answer where the storage condition cannot be met with the limits."""
    FALLBACK = 5
    """The solver gave no answer that passed the check: braking torque, clipped."""
