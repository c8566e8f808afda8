"""Energy shaping and damping injection (theory section 4.1)."""

from __future__ import annotations

from phcontrol._validation import Array
from phcontrol.controllers.parameters import Gain
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.position_law import PositionLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured


class EnergyShaping(PositionLaw):
    """Hold a position or follow a motion: the arm's potential is replaced by another, and damping is injected.

        u = G⁻¹(∂V/∂q − ∂Ψ/∂q + M q̈_ref + C q̇_ref + D q̇_ref) − C Gᵀv_e,    v_e = q̇ − q̇_ref

    The closed loop is, with H_d = ½|p̄_e|² + Ψ, p̄_e = Tᵀv_e, and f_e entering the second row as T⁻¹f_e,

        d/dt (q̃, p̄_e) = [[0, T⁻ᵀ], [−T⁻¹, J̄₂ − D̄ − ḠCḠᵀ]] ∇H_d.

    The arm's friction stays in the loop. Thesis section 3.2.1 without the force feedback (A = 0). Of a spring a
    constant f_e shifts the rest position to q_d + K_p⁻¹f_e.

    Args:
        system: the model of the arm.
        goal: q_d [rad].
        stiffness: K_p, scalar, vector or matrix, positive definite [N·m/rad].
        potential: Ψ in place of these two.
        reference: along what, by default a goal at rest.
        damping: C, scalar, vector or matrix, positive definite [N·m·s/rad].
        interconnection: which J̄₂ the target is written with.
    """

    name = "energy_shaping"

    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)

    def prepare(self) -> None:
        """Form G C Gᵀ."""
        super().prepare()
        G = self.system.input_matrix
        self._joint_damping: Array = self.damping if G is None else G @ self.damping @ G.T

    def cancelled(self, measured: Measured) -> Array | None:
        """Return the part of f_e that the law cancels [N·m]; None for nothing."""
        return None

    def structure(self, t: float, x: MechanicalState) -> Array:
        """Return J̄₂."""
        return x.interconnection(self.interconnection)

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̄_e|² + Ψ [J]."""
        aim = self.aim(t, x)
        return float(0.5 * aim.momentum.dot(aim.momentum)) + aim.energy

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q̃, p̄_e)."""
        aim = self.aim(t, x)
        return Target.of(
            {"error": aim.error, MOMENTUM: (aim.momentum, aim.momentum)},
            lambda: {("error", MOMENTUM): aim.coupling, (MOMENTUM, MOMENTUM): self.structure(t, x)},
            lambda: {(MOMENTUM, MOMENTUM): x.transformed_damping + x.transformed_injection(self.damping)},
            lambda: {} if "external_force" in self.needs else {MOMENTUM: x.inverse_factor},
            self.drive(t, x, measured),
        )

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = −q̇_ref and the effort −∂Ψ/∂q − G C Gᵀv_e; in the coriolis form neither M nor C is formed."""
        aim, known = self.aim(t, x), self.cancelled(measured)
        effort = -(aim.gradient + self._joint_damping.dot(aim.velocity))
        if aim.reference_velocity is not None and self.interconnection == "coriolis":
            leading = x.feedforward(aim.reference_velocity, aim.reference_acceleration)  # type: ignore[arg-type]  # both or none
            return Shaping(effort, cancelled_force=known, leading_force=leading)
        return Shaping(effort, *aim.shift(), cancelled_force=known)

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀv_e, v_eᵀ(D + G C Gᵀ)v_e, and (D + G C Gᵀ)v_e."""
        velocity = self.aim(t, x).velocity
        return PassivePort.of(x, velocity, self._joint_damping.dot(velocity), velocity)
