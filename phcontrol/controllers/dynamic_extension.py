"""The dynamic extension by a state that integrates forces: base of force feedback and force control."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, matrix
from phcontrol.controllers.aim import Aim
from phcontrol.controllers.joint_damped_law import JointDampedLaw
from phcontrol.controllers.parameters import Gain, Parameter
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Blocks, DrivenParts, Part, Target
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.poles.placed_matrices import placed_matrices
from phcontrol.poles.poles import Poles
from phcontrol.sensors.measured import NOTHING, Measured


def invertible(name: str, value: ArrayLike, system: MechanicalSystem) -> Array:
    """Return an invertible (n, n) matrix. Raises InvalidArgumentError when it is not."""
    checked = matrix(name, value, system.n)
    if np.linalg.matrix_rank(checked) < system.n:
        raise InvalidArgumentError(name, "must be invertible")
    return checked


class DynamicExtension(JointDampedLaw):
    """Laws with p̂ = p̄_e − A z, ż = Yᵀf̄, Y = A K_z, about a potential Ψ that the law shapes.

        f̄ = −T⁻¹∂Ψ/∂q + (J̄₂ − D̄)p̄_e  (+ T⁻¹f_e when measured)
        u = G⁻¹(∂V/∂q − ∂Ψ/∂q + T A ż) − C ŷ,   ŷ = Ḡᵀp̂      (and what leads along a reference)
        H_d = ½|p̂|² + Ψ + ½zᵀK_z⁻¹z

    Args:
        damping: C, positive definite [N·m·s/rad].
        coupling: A, any invertible matrix: how strongly z acts; A Y = A K_z Aᵀ is by how much the
            forces are amplified (dimensionless).
        force_gain: K_z, positive definite.
    """

    coupling: Parameter[ArrayLike, Array] = Parameter("A", check=invertible, tuned=lambda tuning: 0.5)
    force_gain: Gain = Gain("K_z", tuned=lambda tuning: 4.0 * tuning.amplification(0.25))  # A K_z Aᵀ

    poles: ClassVar[type[Poles] | None] = None
    """How the poles of a loop are placed for a bandwidth; None where nothing says."""

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return those of the base; for a bandwidth or damping ratio all gains together, which place the poles.

        Raises InvalidArgumentError where one of them is given beside, and PHControlError where none do that.
        """
        made = super().default_gains(system, goal, given=given, **desired)
        if cls.poles is None or all(value is None for value in desired.values()):
            return made
        for name in cls.poles.arguments():
            if given.get(name) is not None:
                raise InvalidArgumentError(
                    name, f"is what a bandwidth places the poles of {cls.name} with: leave out {name}, or the bandwidth"
                )
        tuning = cls.tuning(system, goal, **desired)
        x = system.at(tuning.posture)
        poles = cls.poles(tuning.bandwidth, tuning.damping_ratio)
        return made | placed_matrices(poles, x.mass_matrix, x.damping_matrix, x.input_matrix).gains

    def prepare(self) -> None:
        """Compute Y and K_z⁻¹."""
        super().prepare()
        A = self.coupling
        self._negative_coupling = -A
        self._port = A @ self.force_gain  # Y
        self._storage_gain = np.linalg.inv(self.force_gain)  # K_z⁻¹, once
        self._calming: Array = np.linalg.solve(A.T @ A + self._storage_gain, A.T)

    @property
    def states(self) -> tuple[str, ...]:
        """The force state z, one for each joint."""
        return ("force",)

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, when it is measured."""
        return ("external_force",) if self._feels else ()

    @property
    def _feels(self) -> bool:
        """Whether f̄ includes the measured f_e."""
        return False

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State ϑ = −A z, the rate of z, and the effort −∂Ψ/∂q − G C ŷ."""
        aim = self.aim(t, x)
        pull = -aim.gradient
        driving = pull + self._measurement(measured, "external_force") if self._feels else pull
        state_rate = self._motion_rate(x, aim.velocity, driving).dot(self._port)
        adapted = aim.velocity - x.solve_factor_transposed(self.coupling.dot(state))
        return Shaping(
            pull - x.injected_damping(self.damping, adapted),
            *aim.shift(),
            offset_rate=self._negative_coupling.dot(state_rate),
            state_rate=state_rate,
        )

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + Ψ + ½zᵀK_z⁻¹z [J]."""
        return self._stored(self.aim(t, x), state)

    def _stored(self, aim: Aim, state: Array) -> float:
        momentum = aim.momentum - self.coupling.dot(state)
        return float(0.5 * (momentum.dot(momentum) + state.dot(self._storage_gain.dot(state)))) + aim.energy

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return ŷ, v_eᵀD v_e + ŷᵀC ŷ, and D v_e + G C ŷ."""
        velocity = self.aim(t, x).velocity
        adapted = velocity - x.solve_factor_transposed(self.coupling.dot(state))
        return PassivePort.of(x, adapted, x.injected_damping(self.damping, adapted), velocity)

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return z = (AᵀA + K_z⁻¹)⁻¹Aᵀp̄_e, where ½|p̄_e − A z|² + ½zᵀK_z⁻¹z is smallest."""
        calm: Array = self._calming.dot(self.aim(t, x).momentum)
        return calm

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (position coordinates, p̂, z)."""
        aim = self.aim(t, x)
        momentum = aim.momentum - self.coupling.dot(state)
        return self._extended(aim, aim.error, momentum, state, drive=self.drive(t, x, measured))

    def _extended(
        self,
        aim: Aim,
        error: Part,
        momentum: Array,
        state: Array,
        port: Mapping[str, Array] | None = None,
        lost: Blocks = {},  # noqa: B006 - never written to
        drive: DrivenParts | None = None,
    ) -> Target:
        """Return the target of the parts error, p̂ and z; of ``lost`` the blocks add to R_d."""
        inverse, Y = aim.x.inverse_factor, self._port

        def dissipation() -> Blocks:
            own = self._dissipation(aim)
            return own | {key: own[key] + block for key, block in lost.items()}

        def felt() -> Mapping[str, Array]:
            if port is not None:
                return port
            return {MOMENTUM: inverse, "force": Y.T @ inverse} if self._feels else {MOMENTUM: inverse}

        own = {"force": (state, self._storage_gain.dot(state))}
        parts = {"error": error, MOMENTUM: (momentum, momentum)} | own
        return Target.of(parts, lambda: self._interconnection(aim), dissipation, felt, drive)

    def _interconnection(self, aim: Aim) -> dict[tuple[str, str], Array]:
        """Return the blocks of J_d: those of a mechanical system, and with Y after them those of z."""
        Y, skew, flow = self._port, aim.x.interconnection(self.interconnection), aim.coupling
        return {
            ("error", MOMENTUM): flow,
            ("error", "force"): flow @ Y,
            (MOMENTUM, MOMENTUM): skew,
            (MOMENTUM, "force"): skew @ Y,
            ("force", "force"): Y.T @ skew @ Y,
        }

    def _dissipation(self, aim: Aim) -> dict[tuple[str, str], Array]:
        """Return the blocks of R_d, likewise."""
        Y, friction = self._port, aim.x.transformed_damping
        return {
            (MOMENTUM, MOMENTUM): friction + aim.x.transformed_injection(self.damping),
            (MOMENTUM, "force"): friction @ Y,
            ("force", "force"): Y.T @ friction @ Y,
        }
