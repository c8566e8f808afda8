"""One set of gains that was tried."""

from __future__ import annotations

from typing import NamedTuple


class Trial(NamedTuple):
    """Gains that ``tune`` tried, and what came of it.

    Example:
        >>> from phcontrol import Trial
        >>> Trial({"stiffness": (2.0,)}, float("inf"), "the loop is unstable").reason
        'the loop is unstable'
    """

    factors: dict[str, tuple[float, ...]]
    """Of each gain, over those that it began with: one, or one a joint."""
    value: float
    """Of the objective; infinite for gains that were refused."""
    reason: str
    """Why they were refused; "" if they were not."""
