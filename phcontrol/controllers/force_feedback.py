"""Position control with force feedback by dynamic extension (theory section 4.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, gain, matrix, vector
from phcontrol.controllers.controller import Controller, Shaping, Target, inertia_scaled_gains
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured


class ForceFeedback(Controller):
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
        super().__init__(system, interconnection)
        self.goal = vector("goal", goal, system.n)
        self.stiffness = gain("stiffness", stiffness, system.n)
        self.damping = gain("damping", damping, system.n)
        self.coupling = matrix("coupling", coupling, system.n)
        if np.linalg.matrix_rank(self.coupling) < system.n:
            raise InvalidArgumentError("coupling", "must be invertible")
        self.force_gain = gain("force_gain", force_gain, system.n)
        if not isinstance(measured, bool):
            raise InvalidArgumentError("measured", f"must be True or False, but is {measured!r}")
        self.measured = measured
        self._negative_coupling = -self.coupling
        self._port = self.coupling @ self.force_gain  # Y
        self._storage_gain = np.linalg.inv(self.force_gain)  # K_z⁻¹, once

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return gains critically damped at 4 rad/s or faster, and A K_z Aᵀ = ½."""
        stiffness, damping = inertia_scaled_gains(system, goal)
        return {"goal": goal, "stiffness": stiffness, "damping": damping, "coupling": 0.5, "force_gain": 2.0}

    @property
    def state_parts(self) -> dict[str, int]:
        """The force state z, one for each joint."""
        return {"force": self.system.n}

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, when it is measured."""
        return ("external_force",) if self.measured else ()

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State ϑ = −A z, the rate of z, and the effort −K_p q̃ − G C ŷ."""
        spring = self.stiffness.dot(-x.position_error(self.goal))
        driving = spring + self._measurement(measured, "external_force") if self.measured else spring
        state_rate = x.transformed_rate(driving).dot(self._port)
        output = x.velocity - x.solve_factor_transposed(self.coupling.dot(state))
        return Shaping(
            spring - self._injected(output), offset_rate=self._negative_coupling.dot(state_rate), state_rate=state_rate
        )

    def _injected(self, velocity: Array) -> Array:
        """Return G C Gᵀv, the injected damping at a velocity v = T⁻ᵀp̂ [N·m]."""
        input_matrix = self.system.input_matrix
        if input_matrix is None:
            force: Array = self.damping.dot(velocity)
        else:
            force = input_matrix.dot(self.damping.dot(input_matrix.T.dot(velocity)))
        return force

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + ½q̃ᵀK_p q̃ + ½zᵀK_z⁻¹z [J]."""
        error, momentum = x.position_error(self.goal), self._adapted_momentum(x, state)
        energy = (
            momentum.dot(momentum) + error.dot(self.stiffness.dot(error)) + state.dot(self._storage_gain.dot(state))
        )
        return float(0.5 * energy)

    def _adapted_momentum(self, x: MechanicalState, state: Array) -> Array:
        momentum: Array = x.transformed_momentum - self.coupling.dot(state)
        return momentum

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return (q̃, p̂, z)."""
        return np.concatenate([x.position_error(self.goal), self._adapted_momentum(x, state), state])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q̃, p̂, z)."""
        n, port = x.system.n, self._port
        zero, inverse = np.zeros((n, n)), x.solve_factor(np.eye(n))
        skew, friction = x.interconnection(self.interconnection), x.transformed_damping
        return Target(
            coordinates=self.coordinates(t, x, state),
            interconnection=np.block(
                [
                    [zero, inverse.T, inverse.T @ port],
                    [-inverse, skew, skew @ port],
                    [-port.T @ inverse, -port.T @ skew.T, -port.T @ skew.T @ port],
                ]
            ),
            dissipation=np.block(
                [
                    [zero, zero, zero],
                    [zero, self._injected_damping(x, self.damping), friction @ port],
                    [zero, port.T @ friction, port.T @ friction @ port],
                ]
            ),
            gradient=np.concatenate(
                [
                    self.stiffness.dot(x.position_error(self.goal)),
                    self._adapted_momentum(x, state),
                    self._storage_gain.dot(state),
                ]
            ),
            port=np.vstack([zero, inverse, port.T @ inverse if self.measured else zero]),
        )
