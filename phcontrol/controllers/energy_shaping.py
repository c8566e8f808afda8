"""Energy shaping and damping injection (theory section 4.1)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, gain, vector
from phcontrol.controllers.controller import Controller, PassivePort, Shaping, Target, inertia_scaled_gains
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured


class EnergyShaping(Controller):
    """Hold a position: the arm's potential is replaced by a spring, and damping is injected.

        u = G⁻¹(∂V/∂q − K_p q̃) − C y,    q̃ = q − q_d,  y = Gᵀq̇

    The closed loop is, with H_d = ½|p̄|² + ½q̃ᵀK_p q̃ and f_e entering the second row as T⁻¹f_e,

        d/dt (q̃, p̄) = [[0, T⁻ᵀ], [−T⁻¹, J̄₂ − D̄ − ḠCḠᵀ]] ∇H_d.

    The arm's friction stays in the loop. Thesis section 3.2.1 without the force feedback (A = 0).
    A constant f_e shifts the rest position to q_d + K_p⁻¹f_e.

    Args:
        system: the model of the arm.
        goal: q_d [rad].
        stiffness: K_p, scalar, vector or matrix, positive definite [N·m/rad].
        damping: C, likewise [N·m·s/rad].
        interconnection: which J̄₂ the target is written with.
    """

    name = "energy_shaping"

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        goal: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        interconnection: str = "coriolis",
    ) -> None:
        super().__init__(system, interconnection)
        self.goal = vector("goal", goal, system.n)
        self.stiffness = gain("stiffness", stiffness, system.n)
        self._negative_stiffness = -self.stiffness
        self.damping = gain("damping", damping, system.n)

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return goal, stiffness and damping: critically damped at 4 rad/s or faster."""
        stiffness, damping = inertia_scaled_gains(system, goal)
        return {"goal": goal, "stiffness": stiffness, "damping": damping}

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State θ = 0 and the effort −K_p q̃ − G C y."""
        injected = x.injected_damping(self.damping, x.velocity)
        return Shaping(self._negative_stiffness.dot(x.position_error(self.goal)) - injected)

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½q̇ᵀM q̇ + ½q̃ᵀK_p q̃ [J]."""
        error = x.position_error(self.goal)
        return x.kinetic_energy + float(0.5 * error.dot(self.stiffness.dot(error)))

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return y, q̇ᵀD q̇ + yᵀC y, and D q̇ + G C y."""
        return PassivePort.of(x, x.velocity, x.injected_damping(self.damping, x.velocity), x.velocity)

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return (q̃, p̄)."""
        return np.concatenate([x.position_error(self.goal), x.transformed_momentum])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q̃, p̄)."""
        zero, inverse = np.zeros((x.system.n, x.system.n)), x.solve_factor(np.eye(x.system.n))
        return Target(
            coordinates=self.coordinates(t, x, state),
            interconnection=np.block([[zero, inverse.T], [-inverse, x.interconnection(self.interconnection)]]),
            dissipation=np.block([[zero, zero], [zero, self._injected_damping(x, self.damping)]]),
            gradient=np.concatenate([self.stiffness.dot(x.position_error(self.goal)), x.transformed_momentum]),
            port=np.vstack([zero, inverse]),
        )
