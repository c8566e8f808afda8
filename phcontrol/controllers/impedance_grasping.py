"""Impedance grasping by a virtual spring with a variable rest length (Theorem 4.2.3)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.aim import Aim
from phcontrol.controllers.parameters import Gain
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.regulated_law import VIRTUAL_POSITION, RegulatedLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured


class _Stretched(NamedTuple):
    """The virtual spring at one state."""

    aim: Aim
    error: Array
    """q − q_f [rad]."""
    rest: Array
    """q_rl [rad]."""
    force: Array
    """K_p e [N·m]."""
    rest_force: Array
    """K_rl q_rl [N·m]."""
    adapted: Array
    """T⁻ᵀp̂ = v_e + K_p e [rad/s]."""


class RestLengthPort(NamedTuple):
    """The port (u_rl, y_rl) of the virtual spring (4.45), (4.46): y_rlᵀu_rl is the power into it by its rest length.

    Example:
        >>> import numpy as np
        >>> from phcontrol import RestLengthPort
        >>> RestLengthPort(rate=np.array([0.1]), force=np.array([2.0])).power  # [W]
        0.2
    """

    rate: Array
    """u_rl = q̇_rl, shape (n,) [rad/s]."""
    force: Array
    """y_rl = ∂H_c/∂q_rl = K_rl q_rl − K_p e, shape (n,) [N·m] (errata E15, E39)."""

    @property
    def power(self) -> float:
        """y_rlᵀu_rl [W]: with the power (K_p e)ᵀv_e that the arm's motion brings it makes up Ḣ_c."""
        return float(self.force.dot(self.rate))


class ImpedanceGrasping(RegulatedLaw):
    """Close on a virtual position q_f with a spring whose rest length gives way.

        e = q − q_f − q_rl,   p̂ = p̄ + TᵀK_p e,   ŷ = Ḡᵀp̂,   q̇_rl = −ŷ + K_p e − K_rl q_rl
        p̂̇ = −T⁻¹K_p e + (J̄₂ − D̄ − ḠCḠᵀ)p̂ + Ḡ(−K_p e + K_rl q_rl)

    Thesis (4.41) to (4.56) corrected: errata E15. The closed loop on (q − q_f, p̂, q_rl), with
    H_d = ½|p̂|² + ½eᵀK_p e + ½q_rlᵀK_rl q_rl, is

        [[−1, T⁻ᵀ, 0], [−T⁻¹, J̄₂ − D̄ − ḠCḠᵀ, Ḡ], [0, −Ḡᵀ, −1]] ∇H_d.

    Without ``regulation`` (*virtual*, the thesis's law) the measured f_e is cancelled: q → q_f whatever is in the way,
    and the contact force is whatever the object answers there; K_p q_f is the force of the virtual spring only.
    With ``regulation`` (*regulated*) f_e is not cancelled, it enters as [0; T⁻¹; 0], and q_f moves until the contact
    force is the desired one.

    Args:
        system: the model of the arm.
        goal: q_f [rad]; where q_f starts, with ``regulation``.
        stiffness: K_p, positive definite [N·m/rad].
        reference: a trajectory along which q_f moves, by default it is at rest.
        rest_stiffness: K_rl, positive definite [N·m/rad].
        damping: C, positive definite [N·m·s/rad].
        regulation: the outer integrator, or None.
        interconnection: "coriolis" or "canonical".

    Example:
        >>> from phcontrol import ImpedanceGrasping, JointContact, MechanicalSystem, RigidBody, load_robot
        >>> from phcontrol import simulate
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"))
        >>> law = ImpedanceGrasping.tuned(gripper, [0.0])
        >>> ball = RigidBody(JointContact("gripper", 0.20), stiffness=200.0, damping=1.0)
        >>> log = simulate(gripper, law, duration=2.0, dt=4e-3, bodies=[ball])
        >>> bool(log.contact_force[-1] > 0.05)  # it holds the ball [N·m]
        True
    """

    name = "impedance_grasping"

    stiffness: Gain = Gain("K_p", "N·m/rad", default=None, tuned=lambda tuning: 1.0)
    rest_stiffness: Gain = Gain("K_rl", "N·m/rad", tuned=lambda tuning: 1.0)

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return those of the base. Raises InvalidArgumentError for a bandwidth or a damping ratio."""
        for name, value in desired.items():
            if value is not None:
                raise InvalidArgumentError(
                    name,
                    f"is nothing that the gains of {cls.name} are chosen by: K_p and K_rl say how hard it grasps, and "
                    "so how fast its rest length gives way; give stiffness, rest_stiffness and damping, or use tune()",
                )
        return super().default_gains(system, goal, given=given, **desired)

    def prepare(self) -> None:
        """Check that the spring is one of the joints, which has the rest length of the law."""
        super().prepare()
        if self._spring is None:
            raise InvalidArgumentError("potential", f"must be a JointSpring: {self.name} moves its rest length")
        self._stiffness = self._spring.stiffness

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, to cancel or to regulate."""
        return ("external_force",)

    @property
    def states(self) -> tuple[str, ...]:
        """The rest length; with regulation also how far q_f has moved."""
        return ("rest_length", *super().states)

    def _stretched(self, t: float, x: MechanicalState, state: Array) -> _Stretched:
        n, K = self.system.n, self._stiffness
        aim, rest = self.aim_at_virtual_position(t, x, state[n:]), state[:n]
        error = self.potential.coordinates(x, aim.goal)
        force = K.dot(error - rest)
        return _Stretched(aim, error, rest, force, self.rest_stiffness.dot(rest), aim.velocity + force)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = K_p e, its rate, the rate of the rest length (and of q_f), and the effort."""
        external, at = self._measurement(measured, "external_force"), self._stretched(t, x, state)
        G = x.gears
        output = at.adapted if G is None else G.T.dot(at.adapted)
        rest_rate = at.force - output - at.rest_force
        injected = at.rest_force - at.force - self.damping.dot(output)
        effort, error_rate = (injected if G is None else G.dot(injected)) - at.force, at.aim.velocity - rest_rate
        shift = at.aim.shift(at.force, self._stiffness.dot(error_rate))
        if self.regulation is None:
            return Shaping(effort, *shift, cancelled_force=external, state_rate=rest_rate)
        law = Shaping(effort, *shift, state_rate=np.concatenate([rest_rate, np.zeros(self.system.n)]))
        return self.with_faster_goal(law, self.regulation.rate(external))

    def spring_force(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return K_p e [N·m]."""
        return self._stretched(t, x, state).force

    def with_faster_goal(self, law: Shaping, rate: Array) -> Shaping:
        """Return what is shaped, with q_f moving faster: s = K_p e changes with it."""
        return super().with_faster_goal(law, rate)._replace(acceleration=law.acceleration - self._stiffness.dot(rate))

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + ½eᵀK_p e + ½q_rlᵀK_rl q_rl [J]."""
        at = self._stretched(t, x, state)
        momentum = at.adapted.dot(x.factor)
        return float(0.5 * (momentum.dot(momentum) + at.force.dot(at.error - at.rest) + at.rest.dot(at.rest_force)))

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return ŷ, |K_p e|² + |K_rl q_rl − K_p e|² + the losses by friction and damping, and the force of these."""
        at = self._stretched(t, x, state)
        yielding = at.rest_force - at.force
        injected = x.injected_damping(self.damping, at.adapted)
        losses = at.force.dot(at.force) + yielding.dot(yielding)
        return PassivePort.of(x, at.adapted, injected, at.adapted, losses)

    def rest_length_port(self, t: float, x: MechanicalState, state: Array) -> RestLengthPort:
        """Return the port by which the rest length gives way, with H_c = ½eᵀK_p e + ½q_rlᵀK_rl q_rl (4.38)."""
        at = self._stretched(t, x, state)
        rate = at.force - x.input_matrix.T.dot(at.adapted) - at.rest_force
        return RestLengthPort(rate, at.rest_force - at.force)

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return the rest length where ½|p̂|² + ½eᵀK_p e + ½q_rlᵀK_rl q_rl is smallest."""
        at, M, K = self._stretched(t, x, state), x.mass_matrix, self._stiffness
        # with p̂ = Tᵀ(v_e + K(d − r)): −K M(v_e + K(d − r)) − K(d − r) + K_rl r = 0
        left = K @ M @ K + K + self.rest_stiffness
        right = K.dot(M.dot(at.aim.velocity + K.dot(at.error)) + at.error)
        return np.concatenate([np.linalg.solve(left, right), state[self.system.n :]])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q − q_f, p̂, q_rl); a moving q_f drives its first row."""
        at, one = self._stretched(t, x, state), np.eye(self.system.n)
        momentum = at.adapted.dot(x.factor)
        parts = {
            "error": (at.error, at.force),
            MOMENTUM: (momentum, momentum),
            "rest_length": (at.rest, at.rest_force - at.force),
        }
        if self.regulation is not None:
            parts[VIRTUAL_POSITION] = (state[self.system.n :], np.zeros(self.system.n))
        return Target.of(
            parts,
            lambda: {
                ("error", MOMENTUM): x.inverse_factor.T,
                (MOMENTUM, MOMENTUM): x.interconnection(self.interconnection),
                (MOMENTUM, "rest_length"): x.transformed_input,
            },
            lambda: {
                ("error", "error"): one,
                (MOMENTUM, MOMENTUM): x.transformed_damping + x.transformed_injection(self.damping),
                ("rest_length", "rest_length"): one,
            },
            {} if self.regulation is None else {MOMENTUM: x.inverse_factor},
            self.drive(t, x, measured),
        )
