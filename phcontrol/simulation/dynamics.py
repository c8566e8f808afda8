"""What an integrator asks of a closed loop."""

from __future__ import annotations

from typing import Protocol

from phcontrol._validation import Array


class Dynamics(Protocol):
    """A closed loop with state y = (q, q̇, controller state, …)."""

    n: int

    def rate(self, t: float, y: Array) -> Array:
        """Return ẏ."""
        ...

    def momentum_rate(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return ṗ and the rate of the controller's state."""
        ...

    def momentum(self, y: Array) -> Array:
        """Return p = M(q)q̇."""
        ...

    def velocity(self, position: Array, momentum: Array) -> Array:
        """Return q̇ = M(q)⁻¹p."""
        ...

    def energy(self, position: Array, momentum: Array) -> float:
        """Return H(q, p) = ½pᵀM⁻¹p + V(q) of the arm [J]."""
        ...

    def energy_slope(self, y: Array) -> tuple[Array, Array]:
        """Return ∂H/∂q at constant p [N·m], and D(q̇), shape (n, n) [N·m·s/rad]."""
        ...
