"""What a control loop asks before it starts."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import ArrayLike


class SafeStarts(Protocol):
    """From which states a law may start: a :class:`SafeSet`."""

    @property
    def controller(self) -> Any:
        """The law that it is of."""
        ...

    @property
    def level(self) -> float:
        """The largest H_d of a safe start [J]."""
        ...

    @property
    def binding(self) -> str:
        """The limit that comes first."""
        ...

    def margin(self, position: ArrayLike, velocity: ArrayLike | None = None, state: ArrayLike | None = None) -> float:
        """Return how much energy may yet be brought in [J]; negative for a start that is not safe."""
        ...
