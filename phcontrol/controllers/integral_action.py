"""Position control with force feedback and integral action (docs/theory.md)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.aim import Aim
from phcontrol.controllers.dynamic_extension import DynamicExtension
from phcontrol.controllers.parameters import Gain, Matrix
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.position_law import PositionLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.poles.integral_action_poles import IntegralActionPoles
from phcontrol.sensors.measured import NOTHING, Measured


class IntegralAction(PositionLaw, DynamicExtension):
    """Hold a position against a constant force that is neither known nor measured (Theorem 3.2.5).

        s = Γ∂Ψ/∂q  (K_i q̃ of a joint spring),   p̃ = p̄ − A z + Tᵀs,   ξ̇ = K_ξT⁻ᵀp̃,   ŷ = Ḡᵀp̃,   Y = A K_z
        ż = Yᵀ[−T⁻¹∂Ψ/∂q + (J̄₂ − D̄)(p̃ + A z)]
        p̃̇ = −T⁻¹∂Ψ/∂q + (J̄₂ − D̄)(p̃ + A z) − ḠC ŷ − T⁻¹ξ + T⁻¹f_e

    Thesis (3.41), (3.42), (3.45), (3.51) corrected: errata E13. The closed loop on (q̃, p̃, z, ξ), with
    H_d = ½|p̃|² + Ψ + ½zᵀK_z⁻¹z + ½ξᵀK_ξ⁻¹ξ, has the blocks of :class:`ForceFeedback`, and beside
    them (q̃, q̃) = −Γ = −K_iK_p⁻¹, (p̃, ξ) = −T⁻¹K_ξ, (ξ, p̃) = K_ξT⁻ᵀ; f_e enters as [0; T⁻¹; 0; 0]. The thesis has
    K_ξ = 1 N·m/rad, with which a load is taken up in K_p/K_iK_ξ: half a minute for an arm of some kilograms. Under a
    constant f_e the arm rests at q_d with ξ = f_e; with ξ − f_e in place of ξ H_d is then the Lyapunov function.

    Arguments are those of :class:`ForceFeedback` without ``measured``, and

    Args:
        integral_gain: K_i of a joint spring, scalar, vector or matrix [1/s], such that K_iᵀK_p + K_pK_i is positive
            definite (diagonal gains are when they are positive).
        integral_stiffness: K_ξ, positive definite [N·m/rad]: how much of the error's integral acts; 1 if not given.
        integral_compliance: Γ, with any potential in place of K_i [rad/(N·m·s)], Γ + Γᵀ positive definite.

    Example:
        >>> from phcontrol import IntegralAction, MechanicalSystem, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = IntegralAction.tuned(system, [0.3, 0.2])
        >>> push = [1.0, -0.5]  # [N·m], unknown to the law
        >>> log = simulate(system, law, duration=8.0, dt=5e-3, q0=[0.0, 0.0], disturbance=push)
        >>> bool(abs(log.position[-1] - law.goal).max() < 1e-3)  # [rad]
        True
    """

    name = "integral_action"
    poles = IntegralActionPoles

    integral_gain: Matrix = Matrix("K_i", "1/s", default=None, tuned=lambda tuning: 1.0)
    integral_stiffness: Gain = Gain("K_ξ", "N·m/rad", default=1.0, tuned=lambda tuning: tuning.stiffness)
    integral_compliance: Matrix = Matrix(
        "Γ", "rad/(N·m·s)", default=None, tuned=lambda tuning: np.linalg.inv(tuning.stiffness)
    )

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return the gains of force feedback, K_i = 1/s and K_ξ = K_p; of a potential, Γ for the joints' inertia."""
        other = "integral_gain" if "potential" in given else "integral_compliance"
        return super().default_gains(system, goal, given={**given, other: None}, **desired)

    def prepare(self) -> None:
        """Compute Γ, which must make the storage function fall."""
        super().prepare()
        self._integral_storage = np.linalg.inv(self.integral_stiffness)
        K_i, compliance = self.integral_gain, self.integral_compliance
        if (K_i is None) == (compliance is None):
            raise InvalidArgumentError("integral_gain", "must be given, or integral_compliance in its place")
        if K_i is None:
            self._check("integral_compliance", "Γ + Γᵀ", compliance)
            self._compliance: Array = compliance
            return
        if self.stiffness is None:
            raise InvalidArgumentError(
                "integral_gain", "is of a joint spring: with a potential give integral_compliance"
            )
        self._check("integral_gain", "K_iᵀK_p + K_pK_i", self.stiffness @ K_i)
        self._compliance = np.linalg.solve(self.stiffness, K_i.T).T

    @staticmethod
    def _check(name: str, what: str, product: Array) -> None:
        smallest = float(np.linalg.eigvalsh(product + product.T)[0])
        if smallest <= 0.0:
            raise InvalidArgumentError(
                name, f"{what} must be positive definite, but its smallest eigenvalue is {smallest:g}"
            )

    @property
    def states(self) -> tuple[str, ...]:
        """The force state z and the integral ξ."""
        return ("force", "integral")

    def _split(self, state: Array) -> tuple[Array, Array]:
        return state[: self.system.n], state[self.system.n :]

    def _adapted(self, aim: Aim, force_state: Array) -> tuple[Array, Array]:
        """Return v_e + s, and T⁻ᵀp̃ = v_e + s − T⁻ᵀA z."""
        shifted = aim.velocity + self._compliance.dot(aim.gradient)
        return shifted, shifted - aim.x.solve_factor_transposed(self.coupling.dot(force_state))

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = Γ∂Ψ/∂q, ϑ = −A z, the rates of z and ξ, and the effort −∂Ψ/∂q − G C ŷ − ξ."""
        aim, (force_state, integral) = self.aim(t, x), self._split(state)
        shift, shift_rate = self._compliance.dot(aim.gradient), self._compliance.dot(aim.gradient_rate())
        shifted = aim.velocity + shift
        output = shifted - x.solve_factor_transposed(self.coupling.dot(force_state))
        state_rate = x.structure_rate(self.interconnection, shifted, -aim.gradient).dot(self._port)
        return Shaping(
            -(aim.gradient + x.injected_damping(self.damping, output) + integral),
            *aim.shift(shift, shift_rate),
            offset_rate=self._negative_coupling.dot(state_rate),
            state_rate=np.concatenate([state_rate, self.integral_stiffness.dot(output)]),
        )

    def _momentum(self, aim: Aim, force_state: Array) -> Array:
        momentum: Array = aim.momentum - self.coupling.dot(force_state)
        momentum += self._compliance.dot(aim.gradient).dot(aim.x.factor)
        return momentum

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̃|² + Ψ + ½zᵀK_z⁻¹z + ½ξᵀK_ξ⁻¹ξ [J]."""
        aim, (force_state, integral) = self.aim(t, x), self._split(state)
        momentum = self._momentum(aim, force_state)
        quadratic = momentum.dot(momentum) + force_state.dot(self._storage_gain.dot(force_state))
        return float(0.5 * (quadratic + integral.dot(self._integral_storage.dot(integral)))) + aim.energy

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return ŷ, (∂Ψ/∂q)ᵀΓ∂Ψ/∂q + wᵀD w + ŷᵀC ŷ with w = v_e + s, and D w + G C ŷ."""
        aim = self.aim(t, x)
        shifted, adapted = self._adapted(aim, self._split(state)[0])
        losses = aim.gradient.dot(self._compliance.dot(aim.gradient))
        return PassivePort.of(x, adapted, x.injected_damping(self.damping, adapted), shifted, losses)

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return the z that makes ½|p̃|² + ½zᵀK_z⁻¹z smallest, and ξ as it is: it holds the load."""
        aim = self.aim(t, x)
        shifted = aim.velocity + self._compliance.dot(aim.gradient)
        return np.concatenate([self._calming.dot(shifted.dot(x.factor)), self._split(state)[1]])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q̃, p̃, z, ξ)."""
        aim, (force_state, integral) = self.aim(t, x), self._split(state)
        momentum = self._momentum(aim, force_state)
        return Target.of(
            {
                "error": aim.error,
                MOMENTUM: (momentum, momentum),
                "force": (force_state, self._storage_gain.dot(force_state)),
                "integral": (integral, self._integral_storage.dot(integral)),
            },
            lambda: self._interconnection(aim),
            lambda: self._dissipation(aim),
            lambda: {MOMENTUM: x.inverse_factor},
            self.drive(t, x, measured),
        )

    def _interconnection(self, aim: Aim) -> dict[tuple[str, str], Array]:
        """Add what Γ turns, and the integral of T⁻ᵀp̃."""
        A, turned = aim.coordinate_map, 0.5 * (self._compliance - self._compliance.T)
        return super()._interconnection(aim) | {
            ("error", "error"): -A @ turned @ A.T,
            ("integral", MOMENTUM): self.integral_stiffness.dot(aim.x.inverse_factor.T),
        }

    def _dissipation(self, aim: Aim) -> dict[tuple[str, str], Array]:
        """Add what Γ dissipates."""
        A, even = aim.coordinate_map, 0.5 * (self._compliance + self._compliance.T)
        return super()._dissipation(aim) | {("error", "error"): A @ even @ A.T}
