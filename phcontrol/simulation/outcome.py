"""What became of one of many runs."""

from __future__ import annotations

from typing import Any, NamedTuple


class Outcome(NamedTuple):
    """One of many runs: what was asked of it, or why it failed.

    Example:
        >>> from phcontrol import Outcome
        >>> Outcome(number=0, value=None, error="the arm diverged", compiled=False).error
        'the arm diverged'
    """

    number: int
    """Its place among them."""
    value: Any
    """Its log, its last state, or what a function made of its log; of a run that failed the log so far, if logs were
    asked for, else None."""
    error: str
    """Why it failed; "" for one that came to its end."""
    compiled: bool
    """Whether it was simulated in C."""
