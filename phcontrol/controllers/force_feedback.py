"""Position control with force feedback by dynamic extension (docs/theory.md)."""

from __future__ import annotations

from phcontrol.controllers.dynamic_extension import DynamicExtension
from phcontrol.controllers.parameters import Flag
from phcontrol.controllers.position_law import PositionLaw
from phcontrol.poles.force_feedback_poles import ForceFeedbackPoles


class ForceFeedback(PositionLaw, DynamicExtension):
    """Hold a position with feedback of the forces, by a state z that integrates them (Theorem 3.2.1).

        p̂ = p̄ − A z,   ż = Yᵀf̄,   Y = A K_z,   ŷ = Ḡᵀp̂
        f̄ = −T⁻¹K_p q̃ + (J̄₂ − D̄)p̄  (+ T⁻¹f_e when measured)
        u = G⁻¹(∂V/∂q − K_p q̃ + T A ż) − C ŷ

    Thesis (3.3), (3.11), (3.16) corrected: errata E8, E9, E10. The closed loop on (q̃, p̂, z), with
    H_d = ½|p̂|² + ½q̃ᵀK_p q̃ + ½zᵀK_z⁻¹z, is (3.12) with errata E11:

        [[0, T⁻ᵀ, T⁻ᵀY], [−T⁻¹, J̄₂ − D̄ − ḠCḠᵀ, (J̄₂ − D̄)Y], [−YᵀT⁻¹, −Yᵀ(J̄₂ᵀ + D̄), −Yᵀ(J̄₂ᵀ + D̄)Y]] ∇H_d

    and f_e enters as [0; T⁻¹; 0] (modeled) or [0; T⁻¹; YᵀT⁻¹] (measured). Under a constant f_e the
    modeled law returns to q_d (z takes up the load); the measured one settles at q_d + K_p⁻¹f_e, the
    thesis's (3.40): errata E12. About another potential, Ψ stands for ½q̃ᵀK_p q̃; along a reference the law runs on
    the error state (:class:`Aim`).

    z begins and ends at zero and ż = Yᵀf̄, so that without friction ∫K_p q̃ dt = 0: on a goal that jumps the law must
    overshoot, whatever its gains. Lead it there with a ``reference``.

    Args:
        system: the model of the arm.
        goal: q_d [rad].
        stiffness: K_p, scalar, vector or matrix, positive definite [N·m/rad].
        potential: Ψ in place of these two.
        reference: along what, by default a goal at rest.
        damping: C, likewise [N·m·s/rad].
        coupling: A, any invertible matrix: how strongly z acts; A Y = A K_z Aᵀ is by how much the
            forces are amplified (dimensionless).
        force_gain: K_z, positive definite.
        measured: whether f̄ includes the measured external force (needs ``external_force``).
        interconnection: which J̄₂ the target is written with.

    Example:
        >>> from phcontrol import ForceFeedback, MechanicalSystem, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = ForceFeedback(system, goal=[0.3, 0.2], stiffness=20.0, damping=5.0, coupling=0.5, force_gain=2.0)
        >>> log = simulate(system, law, duration=6.0, dt=5e-3, q0=[0.0, 0.0], disturbance=[1.0, 0.0])  # [N·m]
        >>> bool(abs(log.position[-1] - law.goal).max() < 0.01)  # the spring alone would give way by 0.05 rad
        True
    """

    name = "force_feedback"
    poles = ForceFeedbackPoles

    measured: Flag = Flag(default=False)

    @property
    def _feels(self) -> bool:
        return self.measured
