"""Position control that cancels every measured force (theory section 4.4)."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.controller import PassivePort, Shaping, Target
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured


class TotalForceRejection(EnergyShaping):
    """Hold a position while the measured total force is cancelled in the same instant (3.55 to 3.58).

        f = −∂H/∂q − D q̇ + f_e (measured),   f̄ = T⁻¹f − T⁻¹Ṫp̄
        Ḡu = −f̄ − T⁻¹K_p q̃ − ḠC y

    In joint coordinates u = G⁻¹(−f + Ṫp̄ − K_p q̃) − C y; the thesis's (3.59) has no Ṫp̄: errata E7. The
    closed loop on (q̃, p̄), with H_d = ½|p̄|² + ½q̃ᵀK_p q̃, is (3.56) with damping,

        [[0, T⁻ᵀ], [−T⁻¹, −ḠCḠᵀ]] ∇H_d,

    in which neither f_e nor friction nor gravity is left. Gravity and friction need no model, M(q)
    and Ṁ do. A delay of the sensor is fed back with gain one: the law is only as good as its sensor.

    Arguments and storage function are those of :class:`EnergyShaping`; there is no J̄₂ left to choose, so
    both interconnections are the same law.
    """

    name = "total_force_rejection"

    @property
    def needs(self) -> tuple[str, ...]:
        """The total force."""
        return ("total_force",)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State the effort −f + Ṫp̄ − K_p q̃ − G C y − ∂V/∂q (the base class adds ∂V/∂q again)."""
        held = super().shape(t, x, state, measured).effort
        inertial = x.factor_rate.dot(x.transformed_momentum)
        return Shaping(held + inertial - self._measurement(measured, "total_force") - x.potential_gradient)

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return y, yᵀC y, and G C y: friction is cancelled."""
        return PassivePort.of(x, x.velocity, x.injected_damping(self.damping, x.velocity))

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q̃, p̄); no port is left for f_e."""
        zero, inverse = np.zeros((x.system.n, x.system.n)), x.solve_factor(np.eye(x.system.n))
        damping = x.transformed_input @ self.damping @ x.transformed_input.T
        return Target(
            coordinates=self.coordinates(t, x, state),
            interconnection=np.block([[zero, inverse.T], [-inverse, zero]]),
            dissipation=np.block([[zero, zero], [zero, damping]]),
            gradient=np.concatenate([self.stiffness.dot(x.position_error(self.goal)), x.transformed_momentum]),
            port=np.vstack([zero, zero]),
        )
