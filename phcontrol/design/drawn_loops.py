"""Scenarios that are drawn, as a sweep has them."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class DrawnLoops(Protocol):
    """What ``tune`` needs of a :class:`Sweep`: how many runs there are, and each as arguments of ``simulate``."""

    @property
    def runs(self) -> int:
        """How many runs there are."""

    def loop(self, run: int) -> dict[str, Any]:
        """Return a run, its law included."""
