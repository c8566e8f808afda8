"""Position control with force feedback by dynamic extension (theory section 4.2)."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from phcontrol._validation import Array, gain, vector
from phcontrol.controllers.controller import inertia_scaled_gains
from phcontrol.controllers.dynamic_extension import DynamicExtension
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem


class ForceFeedback(DynamicExtension):
    """Hold a position with feedback of the forces, by a state z that integrates them (Theorem 3.2.1).

        p̂ = p̄ − A z,   ż = Yᵀf̄,   Y = A K_z,   ŷ = Ḡᵀp̂
        f̄ = −T⁻¹K_p q̃ + (J̄₂ − D̄)p̄  (+ T⁻¹f_e when measured)
        u = G⁻¹(∂V/∂q − K_p q̃ + T A ż) − C ŷ

    Thesis (3.3), (3.11), (3.16) corrected: errata E8, E9, E10. The closed loop on (q̃, p̂, z), with
    H_d = ½|p̂|² + ½q̃ᵀK_p q̃ + ½zᵀK_z⁻¹z, is (3.12) with errata E11:

        [[0, T⁻ᵀ, T⁻ᵀY], [−T⁻¹, J̄₂ − D̄ − ḠCḠᵀ, (J̄₂ − D̄)Y], [−YᵀT⁻¹, −Yᵀ(J̄₂ᵀ + D̄), −Yᵀ(J̄₂ᵀ + D̄)Y]] ∇H_d

    and f_e enters as [0; T⁻¹; 0] (modeled) or [0; T⁻¹; YᵀT⁻¹] (measured). Under a constant f_e the
    modeled law returns to q_d (z takes up the load); the measured one settles at q_d + K_p⁻¹f_e, the
    thesis's (3.40): errata E12.

    Args:
        system: the model of the arm.
        goal: q_d [rad].
        stiffness: K_p, scalar, vector or matrix, positive definite [N·m/rad].
        damping: C, likewise [N·m·s/rad].
        coupling: A, any invertible matrix: how strongly z acts; A Y = A K_z Aᵀ is by how much the
            forces are amplified (dimensionless).
        force_gain: K_z, positive definite.
        measured: whether f̄ includes the measured external force (needs ``external_force``).
        interconnection: which J̄₂ the target is written with.
    """

    name = "force_feedback"

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        goal: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        coupling: ArrayLike,
        force_gain: ArrayLike,
        measured: bool = False,
        interconnection: str = "coriolis",
    ) -> None:
        super().__init__(
            system,
            damping=damping,
            coupling=coupling,
            force_gain=force_gain,
            measured=measured,
            interconnection=interconnection,
        )
        self.goal = vector("goal", goal, system.n)
        self.stiffness = gain("stiffness", stiffness, system.n)
        self._negative_stiffness = -self.stiffness

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return gains critically damped at 4 rad/s or faster, and A K_z Aᵀ = ½."""
        stiffness, damping = inertia_scaled_gains(system, goal)
        return {"goal": goal, "stiffness": stiffness, "damping": damping, "coupling": 0.5, "force_gain": 2.0}

    def pull(self, x: MechanicalState) -> Array:
        """Return −K_p q̃ [N·m]."""
        pull: Array = self._negative_stiffness.dot(x.position_error(self.goal))
        return pull

    def potential(self, x: MechanicalState) -> float:
        """Return ½q̃ᵀK_p q̃ [J]."""
        error = x.position_error(self.goal)
        return float(0.5 * error.dot(self.stiffness.dot(error)))

    def position_coordinates(self, x: MechanicalState) -> Array:
        """Return q̃ [rad]."""
        return x.position_error(self.goal)
