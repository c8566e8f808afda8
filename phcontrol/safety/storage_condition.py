"""What a torque that is held for a period does to the storage function."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array
from phcontrol.controllers.passive_port import PassivePort


class StorageCondition(NamedTuple):
    """H_d does not grow over one period more than it would by the law's own torque u★, held likewise.

    With Δ = u − u★, κ = v⁺ − q̇ the change of velocity in the period, ŷ the output, d the dissipated power and r the
    resistance of the law at its beginning, the mean rate of H_d is, to first order in the period,

        P(u) = ŷᵀΔ − d + ½κᵀ(GΔ − r):

    at the beginning Ḣ_d = ŷᵀΔ − d, and then the velocity that the torques GΔ − r act on changes by κ. Since
    κ = κ★ + EΔ, P is a convex parabola in u. The condition is P(u) ≤ max(0, P(u★)); u★ itself always meets it.
    """

    port: PassivePort
    """Of the law, at the beginning."""
    input_matrix: Array | None
    """G; None for the identity."""

    def power(self, change: Array, kick: Array) -> float:
        """Return P [W] for Δ [N·m] and κ [rad/s]."""
        port, matrix = self.port, self.input_matrix
        push = (change if matrix is None else matrix.dot(change)) - port.resistance
        return float(port.output.dot(change) + 0.5 * kick.dot(push)) - port.dissipated_power

    def allowed(self, kick: Array) -> float:
        """Return max(0, P(u★)) [W] for κ★ [rad/s]: what sampling alone does to the law."""
        return max(0.0, -0.5 * float(kick.dot(self.port.resistance)) - self.port.dissipated_power)

    def slope(self, change: Array, kick: Array, effect: Array) -> Array:
        """Return ∂P/∂u = ŷ + ½Gᵀκ + ½Eᵀ(GΔ − r), shape (n,) [rad/s], E = ∂κ/∂u being the effect of the torques."""
        port, matrix = self.port, self.input_matrix
        if matrix is None:
            push, lifted = change - port.resistance, kick
        else:
            push, lifted = matrix.dot(change) - port.resistance, matrix.T.dot(kick)
        result: Array = push.dot(effect)
        result += lifted
        result *= 0.5
        result += port.output
        return result

    def curvature(self, effect: Array) -> Array:
        """Return ∂²P/∂u² = GᵀE, shape (n, n), positive definite [rad/(s·N·m)]."""
        return effect if self.input_matrix is None else self.input_matrix.T.dot(effect)
