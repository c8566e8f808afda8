"""Position control that cancels every measured force (docs/theory.md)."""

from __future__ import annotations

from phcontrol._validation import Array
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured


class TotalForceRejection(EnergyShaping):
    """Hold a position while the measured total force is cancelled in the same instant (3.55 to 3.58).

        f = −∂H/∂q − D q̇ + f_e (measured),   f̄ = T⁻¹f − T⁻¹Ṫp̄
        Ḡu = −f̄ − T⁻¹∂Ψ/∂q − ḠC Gᵀv_e + Ṫᵀq̇_ref + Tᵀq̈_ref

    In joint coordinates u = G⁻¹(−f + Ṫp̄ − K_p q̃) − C y; the thesis's (3.59) has no Ṫp̄: errata E7. The
    closed loop on (q̃, p̄_e), with H_d = ½|p̄_e|² + Ψ, is (3.56) with damping,

        [[0, T⁻ᵀ], [−T⁻¹, −ḠCḠᵀ]] ∇H_d,

    in which neither f_e nor friction nor gravity is left. Gravity and friction need no model, M(q)
    and Ṁ do. A delay of the sensor is fed back with gain one: the law is only as good as its sensor.

    Arguments and storage function are those of :class:`EnergyShaping`; there is no J̄₂ left to choose, so
    both interconnections are the same law.

    Example:
        >>> from phcontrol import MechanicalSystem, TotalForceRejection, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = TotalForceRejection(system, goal=[0.3, 0.2], stiffness=20.0, damping=5.0)
        >>> log = simulate(system, law, duration=3.0, dt=5e-3, q0=[0.0, 0.0], disturbance=[1.0, 0.0])
        >>> bool(abs(log.position[-1] - law.goal).max() < 1e-2)
        True
    """

    name = "total_force_rejection"

    @property
    def needs(self) -> tuple[str, ...]:
        """The total force."""
        return ("total_force",)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q̃, p̄_e); no port is left for f_e."""
        aim = self.aim(t, x)
        return Target.of(
            {"error": aim.error, MOMENTUM: (aim.momentum, aim.momentum)},
            lambda: {("error", MOMENTUM): aim.coupling},
            lambda: {(MOMENTUM, MOMENTUM): x.transformed_injection(self.damping)},
            drive=self.drive(t, x, measured),
        )

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State ϑ = −Tᵀq̇_ref and the effort −f + Ṫp̄ − ∂Ψ/∂q − G C Gᵀv_e − ∂V/∂q (the base adds ∂V/∂q again)."""
        aim = self.aim(t, x)
        effort = x.factor_rate.dot(x.transformed_momentum) - self._measurement(measured, "total_force")
        effort -= x.potential_gradient + aim.gradient + x.injected_damping(self.damping, aim.velocity)
        return Shaping(effort, offset_rate=aim.momentum_shift_rate())

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀv_e, v_eᵀG C Gᵀv_e, and G C Gᵀv_e: friction is cancelled."""
        velocity = self.aim(t, x).velocity
        return PassivePort.of(x, velocity, x.injected_damping(self.damping, velocity))
