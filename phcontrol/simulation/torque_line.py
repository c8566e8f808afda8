"""The torque between the law that orders it and the motors that apply it."""

from __future__ import annotations

from collections import deque

from phcontrol._validation import Array


class TorqueLine:
    """Applies a torque some steps after it was ordered; until the first arrives, a torque given beforehand.

    Args:
        steps: from ordering to acting; 0 for at once.
        first: what acts before, shape (n,) [N·m].
    """

    def __init__(self, steps: int, first: Array) -> None:
        self._steps, self._acting = steps, first
        self._ordered: deque[tuple[int, Array]] = deque()

    def order(self, k: int, torque: Array) -> None:
        """Note what is ordered at step k."""
        self._ordered.append((k + self._steps, torque))

    def acting(self, k: int) -> Array:
        """Return what acts from step k on, shape (n,) [N·m]; steps are asked for in their order."""
        while self._ordered and self._ordered[0][0] <= k:
            self._acting = self._ordered.popleft()[1]
        return self._acting
