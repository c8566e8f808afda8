"""What a torque that is held for a period does to the storage function."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.safety import kernels
from phcontrol.safety.quadratic_constraint import QuadraticConstraint

_NO_LEVER = 1e-12  # of the torques on the storage function, below which none is seen [W]


class StorageCondition(NamedTuple):
    """H_d does not grow over one period more than it would by the law's own torque u★, held likewise.

    With Δ = u − u★, κ = v⁺ − q̇ the change of velocity in the period, ŷ the output, d the dissipated power and r the
    resistance of the law at its beginning, the mean rate of H_d is, to first order in the period,

        P(u) = ŷᵀΔ − d + ½κᵀ(GΔ − r):

    at the beginning Ḣ_d = ŷᵀΔ − d, and then the velocity that the torques GΔ − r act on changes by κ. Since
    κ = κ★ + EΔ, P is a convex parabola in u. The condition is P(u) ≤ max(0, P(u★)); u★ itself always meets it.

    Example:
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, MechanicalSystem, StorageCondition, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping(system, goal=[0.0, 0.0], stiffness=20.0, damping=5.0)
        >>> port = law.passive_port(0.0, system.at([0.1, 0.0], [0.2, 0.0]), np.zeros(0))
        >>> bool(StorageCondition(port, None).power(np.zeros(2), np.zeros(2)) < 0.0)  # the law's own torque [W]
        True
    """

    port: PassivePort
    """Of the law, at the beginning."""
    input_matrix: Array | None
    """G; None for the identity."""

    def power(self, change: Array, kick: Array) -> float:
        """Return P [W] for Δ [N·m] and κ [rad/s]."""
        output, dissipated, resistance = self.port
        matrix = self.input_matrix
        push = change if matrix is None else matrix.dot(change)
        return kernels.mean_power(output, resistance, dissipated, change, kick, push)

    def allowed(self, kick: Array) -> float:
        """Return max(0, P(u★)) [W] for κ★ [rad/s]: what sampling alone does to the law."""
        return max(0.0, -0.5 * float(kick.dot(self.port.resistance)) - self.port.dissipated_power)

    def scaled(
        self, surplus: float, change: Array, kick: Array, effect: Array, centre: Array, reach: Array
    ) -> QuadraticConstraint | None:
        """Return the condition for z = (u − …)/reach, of order one; None where no torque has a lever on H_d.

        Its slope is ∂P/∂u = ŷ + ½Gᵀκ + ½Eᵀ(GΔ − r) [rad/s], its curvature ∂²P/∂u² = GᵀE [rad/(s·N·m)], which is
        positive definite; E = ∂κ/∂u is the effect of the torques.

        Args:
            surplus: P − what is allowed, at Δ and κ [W].
            change: Δ [N·m].
            kick: κ [rad/s].
            effect: E, shape (n, n).
            centre: z at Δ and κ.
            reach: of the torques, shape (n,) [N·m].
        """
        output, _, resistance = self.port
        matrix = self.input_matrix
        if matrix is None:
            push, curvature = change, effect
        else:
            push, kick, curvature = matrix.dot(change), matrix.T.dot(kick), matrix.T.dot(effect)
        size, slope, bend = kernels.storage_parabola(output, resistance, push, kick, effect, curvature, reach)
        return QuadraticConstraint(centre, surplus / size, slope, bend) if size > _NO_LEVER else None
