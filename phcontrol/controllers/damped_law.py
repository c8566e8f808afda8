"""The base of laws that put a potential and a damper in place of the arm's own potential, and nothing else."""

from __future__ import annotations

from abc import abstractmethod

from phcontrol._validation import Array
from phcontrol.controllers.aim import LedAim
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaped_law import ShapedLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured


class DampedLaw(ShapedLaw):
    """Laws u = G⁻¹(∂V/∂q − ∂Ψ/∂q − Δ v_e + M q̈_ref + C q̇_ref + D q̇_ref), with Δ(q) ⪰ 0 the injected damping.

    With H_d = ½|p̄_e|² + Ψ the closed loop is [[0, A T⁻ᵀ], [−T⁻¹Aᵀ, J̄₂ − D̄ − T⁻¹ΔT⁻ᵀ]] ∇H_d on (error, p̄_e), and f_e
    enters the second row as T⁻¹f_e.
    """

    @abstractmethod
    def joint_damping(self, t: float, x: MechanicalState) -> Array:
        """Return Δ, shape (n, n) [N·m·s/rad]."""

    def damping_force(self, t: float, x: MechanicalState, velocity: Array) -> Array:
        """Return Δ v, shape (n,) [N·m]."""
        force: Array = self.joint_damping(t, x).dot(velocity)
        return force

    @property
    def cancels_external_force(self) -> bool:
        """Whether the measured f_e is cancelled."""
        return False

    def structure(self, t: float, x: MechanicalState) -> Array:
        """Return J̄₂."""
        return x.interconnection(self.interconnection)

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̄_e|² + Ψ [J]."""
        aim = self.aim(t, x)
        return float(0.5 * aim.momentum.dot(aim.momentum)) + aim.energy

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (error, p̄_e)."""
        aim = self.aim(t, x)
        return Target.of(
            {"error": aim.error, MOMENTUM: (aim.momentum, aim.momentum)},
            lambda: {("error", MOMENTUM): aim.coupling, (MOMENTUM, MOMENTUM): self.structure(t, x)},
            lambda: {(MOMENTUM, MOMENTUM): x.transformed_damping + x.transformed(self.joint_damping(t, x))},
            lambda: {} if self.cancels_external_force else {MOMENTUM: x.inverse_factor},
            self.drive(t, x, measured),
        )

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = −q̇_ref and the effort −∂Ψ/∂q − Δ v_e; in the coriolis form the whole force, without forming C."""
        aim = self.aim(t, x)
        known = self._measurement(measured, "external_force") if self.cancels_external_force else None
        effort = self.damping_force(t, x, aim.velocity) + aim.gradient
        if isinstance(aim, LedAim) and self.interconnection == "coriolis":
            leading = x.feedforward(aim.reference_velocity, aim.reference_acceleration)
            return Shaping(leading - effort, cancelled_force=known, complete=True)
        return Shaping(-effort, *aim.shift(), cancelled_force=known)

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀv_e, v_eᵀ(D + Δ)v_e, and (D + Δ)v_e."""
        velocity = self.aim(t, x).velocity
        return PassivePort.of(x, velocity, self.damping_force(t, x, velocity), velocity)
