"""The base of laws that give the hand a stiffness and a damping."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol import _validation
from phcontrol._lazy import lazy
from phcontrol._validation import Array, choice, finite_array, positive
from phcontrol.controllers.damped_law import DampedLaw
from phcontrol.controllers.parameters import Gain, NonNegative, Parameter, Vector
from phcontrol.controllers.shaped_law import pose_of
from phcontrol.controllers.tanked_law import TankedLaw
from phcontrol.controllers.tuning import Tuning
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics import kernels
from phcontrol.mechanics.pose import Pose
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.frame_potential import FramePotential, skew
from phcontrol.potentials.joint_spring import JointSpring
from phcontrol.potentials.potential import Potential
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.tanks.action import Action
from phcontrol.tanks.posture_action import PostureAction
from phcontrol.tanks.stiffness import Stiffness
from phcontrol.tanks.stiffness_action import StiffnessAction
from phcontrol.trajectories.frame_path import FramePath

BANDWIDTH = 10.0
"""Of the hand under default stiffness [rad/s]."""
_LEVER = 0.15  # by which a default rotational stiffness is at least the translational one's [m]
_SLIDES = 40  # towards the preferred posture
_STILL = 1e-9  # entries of a Jacobian that count as zero [m, rad]


def _frame(name: str, value: Any, system: MechanicalSystem) -> str:
    system.frame_id(value)
    return str(value)


def _three(name: str, value: Any, system: MechanicalSystem) -> Array:
    if finite_array(name, value).shape == (6,):
        both = "translational_stiffness [N/m] and rotational_stiffness [N·m/rad]"
        raise InvalidArgumentError(name, f"must be three numbers, but are six: give three each as {both}")
    return _validation.gain(name, value, 3)


def _stiffness_function(name: str, value: Any, system: MechanicalSystem) -> Stiffness:
    if not isinstance(value, Stiffness):
        raise InvalidArgumentError(name, f"must be a Stiffness, a function of time, but is {type(value).__name__}")
    return value


def _moving_joints(system: MechanicalSystem, frame: str) -> int:
    """Return how many joints move a frame. Raises InvalidArgumentError where none moves its origin."""
    generator = np.random.default_rng(0)
    jacobian = system.at(system.robot.random_position(generator)).frame_kinematics(frame).jacobian
    if np.abs(jacobian[:3]).max() < _STILL:
        message = f"must be one whose origin the joints of {system.robot.name} move, but '{frame}' stays where it is"
        raise InvalidArgumentError("frame", message)
    return int((np.abs(jacobian).max(axis=0) >= _STILL).sum())


class CartesianLaw(TankedLaw, DampedLaw):
    """Laws that make a frame behave as if a spring and a damper held it at a pose.

    The proof is in docs/cartesian-impedance.md.

        u = G⁻¹(∂V/∂q − 𝒥ᵀF − Δ v_e + …),   Δ = 𝒥ᵀD_x𝒥 + d_n(M − 𝒥ᵀΛ𝒥),   Λ = (𝒥M⁻¹𝒥ᵀ)⁻¹

    with F the wrench of :class:`FrameSpring` less the desired one. D_x gives every direction the damping ratio ζ:
    with B = 𝒥M⁻¹𝒥ᵀ, K = LLᵀ and LᵀBL = U S Uᵀ it is 2ζ L U S^(−½)UᵀLᵀ, positive definite always (A. Albu-Schäffer,
    C. Ott, U. Frese and G. Hirzinger, "Cartesian impedance control of redundant robots: recent results with the
    DLR-light-weight-arms", ICRA 2003). No inverse of 𝒥 is in it, so that torques stay finite in singular postures.
    d_n damps what the hand does not feel.

    Args:
        frame: the hand: name of a link or frame; by default the robot's tool.
        translational_stiffness: K_t, scalar, three numbers or a (3, 3) matrix, positive definite [N/m].
        rotational_stiffness: K_r likewise, in the axes of the goal [N·m/rad]; None leaves the orientation free.
        axes: those of K_t, "world" or "tool", the axes of the goal.
        damping_ratio: ζ of every direction.
        task_damping: D_x in place of ζ, in the axes of the world, scalar, six numbers or a (6, 6) matrix, positive
            definite [N·s/m, N·m·s/rad]; of three where the orientation is free.
        nullspace_damping: d_n, the rate at which motions fade that leave the hand alone [1/s].
        wrench: what the hand exerts beside the spring, (force, torque) in the axes of the world, shape (6,)
            [N, N·m]; the torque is that at the goal's orientation (:class:`FrameWrench`).
        free_direction: a direction in the world along which the spring does not hold, and D_x still damps: to press
            with the ``wrench`` on a surface with that normal, while the hand is led across it.
        posture: None, or what holds the arm's posture beside the hand: "spring" adds a spring on the joints to Ψ, which
            pulls the hand off its goal (``pull_off`` says how far); "tank" leaves the hand alone, and an
            :class:`EnergyTank` pays for it.
        preferred_posture: q_r, the posture that is held, and from which the arm's way to the goal is looked for [rad].
        posture_stiffness: K_n, scalar, vector or matrix, positive definite [N·m/rad].
        variation: K(t), a :class:`Stiffness`, in the axes of K_t and K_r: what it differs from them by is paid for by
            the tank. D_x is that of K(t), so that ζ is the ratio at every moment, as far as the tank lets K(t) act.
    """

    frame: Parameter[str | None, str] = Parameter(default=None, check=_frame)
    translational_stiffness: Parameter[ArrayLike, Array] = Parameter("K_t", "N/m", check=_three)
    rotational_stiffness: Parameter[ArrayLike | None, Array | None] = Parameter(
        "K_r", "N·m/rad", default=None, check=_three
    )
    axes: Parameter[str, str] = Parameter(
        default="world", check=lambda name, value, system: choice(name, value, ("world", "tool"))
    )
    damping_ratio: Parameter[float, float] = Parameter(
        "ζ", default=0.7, check=lambda name, value, system: positive(name, value)
    )
    task_damping: Parameter[ArrayLike | None, ArrayLike | None] = Parameter(
        "D_x", "N·s/m", default=None, check=lambda name, value, system: finite_array(name, value)
    )
    nullspace_damping: NonNegative = NonNegative("d_n", "1/s", default=4.0)
    wrench: Parameter[ArrayLike | None, Array | None] = Parameter(
        "F", "N, N·m", default=None, check=lambda name, value, system: _validation.vector(name, value, 6)
    )
    free_direction: Parameter[ArrayLike | None, Array | None] = Parameter(
        "n", default=None, check=lambda name, value, system: _validation.direction(name, value)
    )
    posture: Parameter[str | None, str | None] = Parameter(
        default=None, check=lambda name, value, system: choice(name, value, ("spring", "tank"))
    )
    preferred_posture: Vector = Vector("q_r", "rad", default=None)
    posture_stiffness: Gain = Gain("K_n", "N·m/rad", default=None)
    variation: Parameter[Stiffness | None, Stiffness | None] = Parameter(
        "K(t)", default=None, check=_stiffness_function
    )

    def pose_at(self, t: float) -> Pose:
        """Return where the hand should be at time t [s]: on the path."""
        if not isinstance(self.reference, FramePath):
            kind = type(self.reference).__name__
            raise InvalidArgumentError("reference", f"must be the path of a frame, but is {kind}")
        return pose_of(self.reference.at(t))

    def prepare(self) -> None:
        """Resolve the frame, the square root of the stiffness and the damping."""
        if self.frame is None:
            self.frame = self.system.hand_frame
        K_r = self.rotational_stiffness
        turns = K_r is not None
        self._rows = 6 if turns else 3
        if turns and self.system.n < 6:
            message = f"needs 6 joints, and {self.system.robot.name} has {self.system.n}: leave the orientation free"
            raise InvalidArgumentError("rotational_stiffness", message)
        moving = _moving_joints(self.system, self.frame)
        if turns and moving < 6:
            message = f"'{self.frame}' is moved by {moving} joints, and a rotational_stiffness needs 6: leave that out"
            raise InvalidArgumentError("frame", message)
        if self.posture is not None:
            for name in ("preferred_posture", "posture_stiffness"):
                if getattr(self, name) is None:
                    raise InvalidArgumentError(name, f"must be given for posture='{self.posture}'")
        if self.variation is not None and self.variation.rotational(0.0) is not None and not turns:
            raise InvalidArgumentError("variation", "changes a rotational stiffness, and the law has none")
        turn = self.pose_at(0.0).rotation
        self._axes = np.eye(3) if self.axes == "world" else turn
        self._linear = self.translational_stiffness if self.axes == "world" else self._in_goal_axes(turn)
        self._across = np.eye(3)
        if self.free_direction is not None:
            self._across = self._across - np.outer(self.free_direction, self.free_direction)
        self._held: Array = self._across @ self._linear @ self._across
        self._roots = _root(self._linear), None if K_r is None else _root(K_r)
        self._given_factor: Array | None = None
        if self.task_damping is not None:
            damping = _validation.gain("task_damping", self.task_damping, self._rows)
            self._given_factor = np.asarray(np.linalg.cholesky(damping), dtype=float)
        self.hand_spring = self.spring(self.wrench)
        """The part of Ψ that is on the hand."""
        super().prepare()

    def _in_goal_axes(self, turn: Array) -> Array:
        if self.reference is not None:
            raise InvalidArgumentError("axes", "'tool' goes with a goal at rest: along a path give K_t in 'world' axes")
        stiffness: Array = turn @ self.translational_stiffness @ turn.T
        return stiffness

    def shaped(self) -> Potential:
        """Return the spring on the frame with the wrench, and with posture="spring" one on the joints."""
        if self.posture != "spring":
            return self.hand_spring
        if self.reference is not None:
            raise InvalidArgumentError("posture", "'spring' would be left behind by a path: use posture='tank'")
        return self.hand_spring + JointSpring(self.preferred_posture, self.posture_stiffness)

    def spring(self, wrench: Array | None) -> FramePotential:
        """Return the spring on the hand with a wrench that the hand exerts beside it, shape (6,) [N, N·m]."""
        goal = self.pose_at(0.0)
        turning, K_r = None, self.rotational_stiffness
        if K_r is not None:
            turning = K_r - 0.5 * np.trace(K_r) * np.eye(3)  # −G
        force = None
        if wrench is not None:
            force = -wrench[:3]
            if turning is not None:
                turning = turning - 0.5 * skew(goal.rotation.T @ wrench[3:])
            elif wrench[3:].any():
                raise InvalidArgumentError("wrench", "has a torque, which needs a rotational_stiffness to turn against")
        return FramePotential(self.frame, goal, stiffness=self._held, force=force, turning=turning)

    @property
    def leading_spring(self) -> FramePotential:
        """The spring on the hand, without the wrench."""
        return self.spring(None)

    @property
    def start_posture(self) -> Array:
        """The preferred posture, or one near home [rad]."""
        return self.system.robot.near_home() if self.preferred_posture is None else self.preferred_posture

    def rest_posture(self, t: float) -> Array:
        """Return where Ψ is smallest, and of those postures with posture="tank" the one where its spring rests too."""
        posture = super().rest_posture(t)
        if self.posture != "tank" or self.system.n == self._rows:
            return posture
        key = t if self.reference is not None else 0.0
        if key not in self._settled:
            self._settled[key] = self._slid(posture, self.pose_at(t))
        return self._settled[key]

    @lazy
    def _settled(self) -> dict[float, Array]:
        return {}

    def _slid(self, posture: Array, goal: Pose) -> Array:
        """Return the posture of least spring that holds the hand at a goal: steps in the null space of 𝒥, and back."""
        for _ in range(_SLIDES):
            jacobian = self.system.at(posture).frame_kinematics(self.frame).jacobian[: self._rows]
            free = np.linalg.svd(jacobian)[2][self._rows :]
            pull = free @ self.posture_stiffness @ self.system.robot.difference(posture, self.preferred_posture)
            step = np.linalg.solve(free @ self.posture_stiffness @ free.T, pull) @ free
            if np.abs(step).max() < 1e-12:
                break
            posture = self._least_at_rest.minimum_near(self.system, posture - step, goal)
        return posture

    def own_actions(self) -> tuple[Action, ...]:
        """Return the posture's projected spring, and what varies of the stiffness."""
        actions: list[Action] = []
        if self.posture == "tank":
            held = self.preferred_posture, self.posture_stiffness
            actions.append(PostureAction(self.system, self.frame, *held, rows=self._rows))
        if self.variation is not None:
            K_r = np.zeros((3, 3)) if self.rotational_stiffness is None else self.rotational_stiffness
            across = self._across @ self._axes
            actions.append(StiffnessAction(self.frame, self.pose_at, self.variation, across, (self._held, K_r)))
        return tuple(actions)

    def task_damping_matrix(self, t: float, x: MechanicalState) -> Array:
        """Return D_x at a state, shape (6, 6), or (3, 3) with a free orientation [N·s/m, N·m·s/rad]."""
        factor = self._damping_factor(t, x)
        damping: Array = factor.dot(factor.T)
        return damping

    def _damping_factor(self, t: float, x: MechanicalState) -> Array:
        """Return X with D_x = X Xᵀ: (2ζ)^½ L U S^(−¼)."""
        if self._given_factor is not None:
            return self._given_factor
        known: tuple[float, Array] | None = x.kept.get(self)
        if known is None or (self.variation is not None and known[0] != t):
            known = x.kept[self] = t, self._designed_factor(t, x)
        return known[1]

    def _designed_factor(self, t: float, x: MechanicalState) -> Array:
        linear, turning = self._roots if self.variation is None else self._roots_at(t, self.variation)
        mobility = x.task_space(self.frame, self._rows).mobility
        rotation = None if turning is None else x.frame_kinematics(self.frame).rotation
        return kernels.damping_root(linear, turning, rotation, mobility, self.damping_ratio)

    def _roots_at(self, t: float, variation: Stiffness) -> tuple[Array, Array | None]:
        """Return factors L of K_t(t) and K_r(t), K = LLᵀ: D_x is the same of any; None for a law without K_r."""
        linear, turning = variation.translational(t), variation.rotational(t)
        axes = self._axes
        return (
            self._roots[0] if linear is None else kernels.factor(axes @ linear @ axes.T),
            self._roots[1] if turning is None else kernels.factor(turning),
        )

    def damping_force(self, t: float, x: MechanicalState, velocity: Array) -> Array:
        """Return Δ v, shape (n,) [N·m]."""
        known = x.kept.get((self, "damping"))
        if known is not None and known[1] is velocity and (self.variation is None or known[0] == t):
            return known[2]  # type: ignore[no-any-return]
        task, factor = x.task_space(self.frame, self._rows), self._damping_factor(t, x)
        force = kernels.hand_damping(
            task.jacobian, factor, task.regular_mobility, x.mass_matrix, velocity, self.nullspace_damping
        )
        x.kept[self, "damping"] = t, velocity, force
        return force

    def port_velocity(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return v_e, shape (n,) [rad/s]."""
        return x.velocity if self.reference is None else self.aim(t, x).velocity

    def joint_damping(self, t: float, x: MechanicalState) -> Array:
        """Return Δ = 𝒥ᵀD_x𝒥 + d_n T P Tᵀ, shape (n, n) [N·m·s/rad]."""
        task = x.task_space(self.frame, self._rows)
        lever = task.jacobian.T @ self._damping_factor(t, x)
        damping: Array = lever @ lever.T
        damping += self.nullspace_damping * (x.factor @ task.projector @ x.factor.T)
        return damping

    # --- gains that suit an arm -------------------------------------------------------------------------

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Any, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return a stiffness with the hand at ``BANDWIDTH`` (or the desired one), and what a posture needs.

        Of the hand's inertia at the goal the harmonic mean over the directions is taken: heavy ones, near
        singularities, do not count for more. K_r is at least what K_t is on a lever of 0.15 m.
        """
        posture = system.robot.near_home() if isinstance(goal, (Pose, pin.SE3)) else np.asarray(goal)
        frame = given.get("frame") or system.hand_frame
        moving = _moving_joints(system, frame)
        x = system.at(posture)
        mobility = x.task_space(frame).mobility
        square = (desired.get("bandwidth") or BANDWIDTH) ** 2
        linear = square * 3.0 / float(np.trace(mobility[:3, :3]))
        made: dict[str, Any] = {"translational_stiffness": linear, "preferred_posture": posture}
        if moving >= 6:
            lightest = 3.0 / max(float(np.trace(mobility[3:, 3:])), 1e-12)
            made["rotational_stiffness"] = max(square * lightest, _LEVER**2 * linear)
        if desired.get("damping_ratio") is not None:
            made["damping_ratio"] = desired["damping_ratio"]
        if given.get("posture") is not None:
            made["posture_stiffness"] = Tuning(system, posture, posture).stiffness
        return {name: value for name, value in made.items() if name not in given}


def _root(stiffness: Array) -> Array:
    """Return the symmetric square root of a positive definite matrix."""
    values, vectors = np.linalg.eigh(stiffness)
    root: Array = (vectors * np.sqrt(values)) @ vectors.T
    return root
