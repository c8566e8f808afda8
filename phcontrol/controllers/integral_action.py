"""Position control with force feedback and integral action (theory section 4.3)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, matrix
from phcontrol.controllers.controller import PassivePort, Shaping, Target
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured


class IntegralAction(ForceFeedback):
    """Hold a position against a constant force that is neither known nor measured (Theorem 3.2.5).

        p̃ = p̄ − A z + TᵀK_i q̃,   ξ̇ = T⁻ᵀp̃,   ŷ = Ḡᵀp̃,   Y = A K_z
        ż = Yᵀ[−T⁻¹K_p q̃ + (J̄₂ − D̄)(p̃ + A z)]
        p̃̇ = −T⁻¹K_p q̃ + (J̄₂ − D̄)(p̃ + A z) − ḠC ŷ − T⁻¹ξ + T⁻¹f_e

    Thesis (3.41), (3.42), (3.45), (3.51) corrected: errata E13. The closed loop on (q̃, p̃, z, ξ), with
    H_d = ½|p̃|² + ½q̃ᵀK_p q̃ + ½zᵀK_z⁻¹z + ½|ξ|², has the blocks of :class:`ForceFeedback`, and beside
    them (q̃, q̃) = −K_iK_p⁻¹, (p̃, ξ) = −T⁻¹, (ξ, p̃) = T⁻ᵀ; f_e enters as [0; T⁻¹; 0; 0]. Under a constant
    f_e the arm rests at q_d with ξ = f_e; ½|ξ − f_e|² in place of ½|ξ|² is then the Lyapunov function.

    Arguments are those of :class:`ForceFeedback` without ``measured``, and

    Args:
        integral_gain: K_i, scalar, vector or matrix [1/s], such that K_iᵀK_p + K_pK_i is positive definite
            (diagonal gains are when they are positive).
    """

    name = "integral_action"

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        goal: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        coupling: ArrayLike,
        force_gain: ArrayLike,
        integral_gain: ArrayLike,
        interconnection: str = "coriolis",
    ) -> None:
        super().__init__(
            system,
            goal=goal,
            stiffness=stiffness,
            damping=damping,
            coupling=coupling,
            force_gain=force_gain,
            interconnection=interconnection,
        )
        self.integral_gain = matrix("integral_gain", finite_array("integral_gain", integral_gain), system.n)
        product = self.stiffness @ self.integral_gain
        smallest = float(np.linalg.eigvalsh(product + product.T)[0])
        if smallest <= 0.0:
            raise InvalidArgumentError(
                "integral_gain",
                f"K_iᵀK_p + K_pK_i must be positive definite, but its smallest eigenvalue is {smallest:g}",
            )

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return the gains of force feedback, and K_i = 1/s."""
        return super().default_gains(system, goal) | {"integral_gain": 1.0}

    @property
    def state_parts(self) -> dict[str, int]:
        """The force state z and the integral ξ."""
        return super().state_parts | {"integral": self.system.n}

    def _split(self, state: Array) -> tuple[Array, Array]:
        return state[: self.system.n], state[self.system.n :]

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = K_i q̃, ϑ = −A z, the rates of z and ξ, and the effort −K_p q̃ − G C ŷ − ξ."""
        force_state, integral = self._split(state)
        error = x.position_error(self.goal)
        spring = self.pull(x)
        shift, shift_rate = self.integral_gain.dot(error), self.integral_gain.dot(x.velocity)
        motion = x.structure_rate(self.interconnection, x.velocity + shift)
        state_rate = (x.solve_factor(spring) + motion).dot(self._port)
        output = x.velocity + shift - x.solve_factor_transposed(self.coupling.dot(force_state))
        return Shaping(
            effort=spring - x.injected_damping(self.damping, output) - integral,
            velocity=shift,
            acceleration=shift_rate,
            offset_rate=self._negative_coupling.dot(state_rate),
            state_rate=np.concatenate([state_rate, output]),
        )

    def _adapted_momentum(self, x: MechanicalState, state: Array) -> Array:
        shift: Array = self.integral_gain.dot(x.position_error(self.goal)).dot(x.factor)
        return super()._adapted_momentum(x, self._split(state)[0]) + shift

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̃|² + ½q̃ᵀK_p q̃ + ½zᵀK_z⁻¹z + ½|ξ|² [J]."""
        momentum, (force_state, integral) = self._adapted_momentum(x, state), self._split(state)
        quadratic = momentum.dot(momentum) + force_state.dot(self._storage_gain.dot(force_state))
        return float(0.5 * (quadratic + integral.dot(integral))) + self.potential(x)

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return ŷ, q̃ᵀK_pK_i q̃ + wᵀD w + ŷᵀC ŷ with w = q̇ + K_i q̃, and D w + G C ŷ."""
        error = x.position_error(self.goal)
        shift = self.integral_gain.dot(error)
        shifted = x.velocity + shift
        adapted = shifted - x.solve_factor_transposed(self.coupling.dot(self._split(state)[0]))
        injected = x.injected_damping(self.damping, adapted)
        return PassivePort.of(x, adapted, injected, shifted, self.stiffness.dot(error).dot(shift))

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return the z that makes ½|p̃|² + ½zᵀK_z⁻¹z smallest, and ξ as it is: it holds the load."""
        shifted = x.velocity + self.integral_gain.dot(x.position_error(self.goal))
        return np.concatenate([self._calming.dot(shifted.dot(x.factor)), self._split(state)[1]])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q̃, p̃, z, ξ)."""
        n = x.system.n
        force_state, integral = self._split(state)
        inner = super().target(t, x, force_state, measured)
        J, R, port = (np.zeros((4 * n, width)) for width in (4 * n, 4 * n, n))
        J[: 3 * n, : 3 * n], R[: 3 * n, : 3 * n], port[: 3 * n] = inner.interconnection, inner.dissipation, inner.port
        drift = np.linalg.solve(self.stiffness, self.integral_gain.T).T  # K_i K_p⁻¹
        R[:n, :n] = 0.5 * (drift + drift.T)
        J[:n, :n] = -0.5 * (drift - drift.T)
        inverse = x.solve_factor(np.eye(n))
        J[n : 2 * n, 3 * n :], J[3 * n :, n : 2 * n] = -inverse, inverse.T
        gradient = np.concatenate(
            [
                -self.pull(x),
                self._adapted_momentum(x, state),
                self._storage_gain.dot(force_state),
                integral,
            ]
        )
        return Target(self.coordinates(t, x, state), J, R, gradient, port)
