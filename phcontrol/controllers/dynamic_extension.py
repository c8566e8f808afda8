"""The dynamic extension by a state that integrates forces: base of force feedback and force control."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, gain, matrix
from phcontrol.controllers.controller import Controller, PassivePort, Shaping, Target
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured


class DynamicExtension(Controller):
    """Laws with p̂ = p̄ − A z, ż = Yᵀf̄, Y = A K_z, about a potential Ψ(q) that the law shapes.

        f̄ = −T⁻¹∂Ψ/∂q + (J̄₂ − D̄)p̄  (+ T⁻¹f_e when measured)
        u = G⁻¹(∂V/∂q − ∂Ψ/∂q + T A ż) − C ŷ,   ŷ = Ḡᵀp̂
        H_d = ½|p̂|² + Ψ(q) + ½zᵀK_z⁻¹z

    A law states Ψ and its gradient; everything else is here.
    """

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        damping: ArrayLike,
        coupling: ArrayLike,
        force_gain: ArrayLike,
        measured: bool,
        interconnection: str,
    ) -> None:
        super().__init__(system, interconnection)
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
        A = self.coupling
        self._calming: Array = np.linalg.solve(A.T @ A + self._storage_gain, A.T)

    @abstractmethod
    def pull(self, x: MechanicalState) -> Array:
        """Return −∂Ψ/∂q, shape (n,) [N·m]."""

    @abstractmethod
    def potential(self, x: MechanicalState) -> float:
        """Return Ψ(q) [J]."""

    @abstractmethod
    def position_coordinates(self, x: MechanicalState) -> Array:
        """Return the coordinates that Ψ is written in, with the rates q̇: q, or q − q_d."""

    @property
    def state_parts(self) -> dict[str, int]:
        """The force state z, one for each joint."""
        return {"force": self.system.n}

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, when it is measured."""
        return ("external_force",) if self.measured else ()

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State ϑ = −A z, the rate of z, and the effort −∂Ψ/∂q − G C ŷ."""
        spring = self.pull(x)
        driving = spring + self._measurement(measured, "external_force") if self.measured else spring
        state_rate = x.transformed_rate(driving).dot(self._port)
        adapted = x.velocity - x.solve_factor_transposed(self.coupling.dot(state))
        return Shaping(
            spring - x.injected_damping(self.damping, adapted),
            offset_rate=self._negative_coupling.dot(state_rate),
            state_rate=state_rate,
        )

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + Ψ(q) + ½zᵀK_z⁻¹z [J]."""
        momentum = self._adapted_momentum(x, state)
        return float(0.5 * (momentum.dot(momentum) + state.dot(self._storage_gain.dot(state)))) + self.potential(x)

    def _adapted_momentum(self, x: MechanicalState, state: Array) -> Array:
        momentum: Array = x.transformed_momentum - self.coupling.dot(state)
        return momentum

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return ŷ, q̇ᵀD q̇ + ŷᵀC ŷ, and D q̇ + G C ŷ."""
        adapted = x.velocity - x.solve_factor_transposed(self.coupling.dot(state))
        return PassivePort.of(x, adapted, x.injected_damping(self.damping, adapted), x.velocity)

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return z = (AᵀA + K_z⁻¹)⁻¹Aᵀp̄, where ½|p̄ − A z|² + ½zᵀK_z⁻¹z is smallest."""
        calm: Array = self._calming.dot(x.transformed_momentum)
        return calm

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return (position coordinates, p̂, z)."""
        return np.concatenate([self.position_coordinates(x), self._adapted_momentum(x, state), state])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (position coordinates, p̂, z)."""
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
                    -self.pull(x),
                    self._adapted_momentum(x, state),
                    self._storage_gain.dot(state),
                ]
            ),
            port=np.vstack([zero, inverse, port.T @ inverse if self.measured else zero]),
        )
