"""The base of all laws: the contract, the gains, and the one matching formula."""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, vector
from phcontrol.exceptions import InvalidArgumentError, MissingMeasurementError, NonFiniteTorqueError, UnknownNameError
from phcontrol.mechanics.state import INTERCONNECTIONS, MechanicalState
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.vision.scene import Scene

EMPTY: Array = np.zeros(0)
EMPTY.flags.writeable = False

Law = TypeVar("Law", bound="Controller")


class Command(NamedTuple):
    """What a controller orders: a torque and the rate of its own state."""

    torque: Array
    """u, shape (n,) [N·m]."""
    state_rate: Array
    """Rate of the controller's state, same shape as the state."""


class PassivePort(NamedTuple):
    """How a change of the torque reaches the storage function: Ḣ_d = … − dissipated_power + outputᵀ(u − u★)."""

    output: Array
    """ŷ = Ḡᵀp̂, shape (n,) [rad/s]."""
    dissipated_power: float
    """∇H_dᵀR_d∇H_d ≥ 0 [W]."""
    resistance: Array
    """½∂(dissipated_power)/∂q̇ at a fixed D(q̇), shape (n,) [N·m]: the force by which the law, and friction, damp."""

    @classmethod
    def of(
        cls,
        x: MechanicalState,
        velocity: Array,
        injected: Array,
        sliding: Array | None = None,
        further_losses: float = 0.0,
    ) -> PassivePort:
        """Return the port of a law whose closed loop dissipates vᵀ(injected) + wᵀD(q̇)w + further losses.

        Args:
            x: the state.
            velocity: v = T⁻ᵀp̂, shape (n,) [rad/s].
            injected: the injected damping's force, mostly G C Gᵀv, shape (n,) [N·m].
            sliding: w, the velocity with which friction appears in the closed loop; None where it is cancelled.
            further_losses: what does not depend on q̇ [W].
        """
        matrix = x.system.input_matrix
        output = velocity if matrix is None else matrix.T.dot(velocity)
        power = further_losses + velocity.dot(injected)
        if sliding is not None and x.system.friction is not None:
            friction = x.damping * sliding
            power, injected = power + sliding.dot(friction), injected + friction
        return cls(output, float(power), injected)


class Shaping(NamedTuple):
    """What a law states; the matching formula makes the torque of it.

    The adapted momentum is p̂ = p̄ + θ with θ = Tᵀs + ϑ, and the wished dynamics are
    p̂̇ = (J̄₂ − D̄)(p̄ + Tᵀs) + T⁻¹ effort + T⁻¹(f_e − cancelled_force).
    """

    effort: Array
    """T times the rest of F★, shape (n,) [N·m]."""
    velocity: Array | None = None
    """s, shape (n,) [rad/s]; None for zero."""
    acceleration: Array | None = None
    """ṡ along the closed loop, shape (n,) [rad/s²]; goes with ``velocity``."""
    offset_rate: Array | None = None
    """ϑ̇, shape (n,); None for zero."""
    cancelled_force: Array | None = None
    """The measured part of f_e that the law cancels, shape (n,) [N·m]; None for nothing."""
    state_rate: Array = EMPTY
    """Rate of the controller's own state."""


class Drive(NamedTuple):
    """What moves a closed loop beside its energy and f_e: a goal that moves, a force that is desired.

    It comes from outside: ``signal`` depends on time and measurements alone, never on the state of arm or controller,
    and it enters no row of a momentum (that would be a torque, and no promise).
    """

    port: Array
    """How the signal enters, shape (len(x), k)."""
    signal: Array
    """Shape (k,)."""


@dataclass(frozen=True)
class Target:
    """The port-Hamiltonian system that a law promises: ẋ = (J − R)∇H_d + port·f_e, at one state."""

    coordinates: Array
    """x, for instance (q̃, p̂, z)."""
    interconnection: Array
    """J_d, skew-symmetric."""
    dissipation: Array
    """R_d, symmetric positive semidefinite."""
    gradient: Array
    """∇H_d with respect to x."""
    port: Array
    """How f_e enters, shape (len(x), n)."""
    drive: Drive | None = None
    """What else moves x; only for a law that says what it is driven by (``Controller.driven_by``)."""

    def rate(self, external_force: Array) -> Array:
        """Return ẋ as promised, under an external force [N·m]."""
        rate: Array = (self.interconnection - self.dissipation) @ self.gradient + self.port @ external_force
        return rate if self.drive is None else rate + self.driven()

    def driven(self) -> Array:
        """Return the part of ẋ that the drive makes."""
        return np.zeros(len(self.gradient)) if self.drive is None else self.drive.port @ self.drive.signal


class Controller(ABC):
    """A law of energy-based control. Stateless: gains are fixed and checked when it is made.

    ``system`` is the model that the law computes with; the plant it is tried on may be another.
    A law states its :class:`Shaping`; the torque follows from it for every law alike,

        u = G⁻¹T[F★ − θ̇ + T⁻¹∂V/∂q − (J̄₂ − D̄)p̄ − T⁻¹f_known],

    in which terms that cancel are never computed: for ``interconnection="coriolis"`` it reads
    u = G⁻¹[∂V/∂q − M ṡ − C s − D s − T ϑ̇ + effort − f_known], for "canonical" (the thesis's J̄₂)
    C s is replaced by T(Ṫᵀs) − T J̄₂Tᵀs.

    Laws with s = 0 give the same torque for both, since both J̄₂ agree on p̄; their targets differ.
    """

    name: ClassVar[str]
    """The law's name on the command line."""
    forms: ClassVar[tuple[str, ...]] = INTERCONNECTIONS
    """The choices of J̄₂ that the law knows."""

    def __init__(self, system: MechanicalSystem, interconnection: str) -> None:
        check_system(system)
        self.system = system
        self.interconnection = choice("interconnection", interconnection, self.forms)
        self._canonical = self.interconnection == "canonical"

    @property
    def caveat(self) -> str:
        """What the law does not claim, in words; empty when there is nothing to say."""
        return ""

    @property
    def driven_by(self) -> str:
        """What drives the closed loop from outside (``Target.drive``); empty when it is passive from f_e to ŷ."""
        return ""

    @property
    def lacks_minimum(self) -> str:
        """What the law has instead of a strict minimum of H_d where it rests; empty when it has one.

        A law with a minimum promises asymptotic stability too. One without may keep modes that neither grow nor fade.
        """
        return ""

    # --- what a law states ----------------------------------------------------------------------

    @abstractmethod
    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """Return what the law states at time t [s]; see :class:`Shaping`."""

    @abstractmethod
    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return the storage function H_d [J]."""

    @abstractmethod
    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return the coordinates x that the target system is written in."""

    @abstractmethod
    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the promised closed loop at one state."""

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return ŷ, the power that the promised closed loop dissipates, ∇H_dᵀR_d∇H_d, and the force that takes it.

        Here from target and storage function: H_d and, with R_d held, the dissipated power are quadratic in q̇, so that
        ŷ = GᵀM⁻¹∂H_d/∂q̇ and the resistance come out exactly from central differences of any length. Laws give all of
        it in closed form, which is faster.
        """
        R, at = self.target(t, x, state, measured).dissipation, x.system.state_type

        def losses_and_energy(y: MechanicalState) -> Array:
            gradient = self.target(t, y, state, measured).gradient
            return np.array([gradient.dot(R.dot(gradient)), self.storage(t, y, state, measured)])

        slopes = np.empty((x.system.n, 2))
        for joint, unit in enumerate(np.eye(x.system.n)):
            ahead, behind = at(x.system, x.position, x.velocity + unit), at(x.system, x.position, x.velocity - unit)
            slopes[joint] = 0.5 * (losses_and_energy(ahead) - losses_and_energy(behind))
        output = x.input_matrix.T.dot(x.solve_factor_transposed(x.solve_factor(slopes[:, 1])))
        return PassivePort(output, float(losses_and_energy(x)[0]), 0.5 * slopes[:, 0])

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return the law's own state that makes H_d smallest at a state of the arm; the same if it has no such form.

        Where limits hold the arm back, moving the law's state towards it takes energy out of H_d again: a state that
        integrates forces does not wind up.
        """
        return state

    @property
    def state_parts(self) -> dict[str, int]:
        """Lengths of the parts of the controller's own state, by name, in their order."""
        return {}

    @property
    def state_size(self) -> int:
        """Length of the controller's own state."""
        return sum(self.state_parts.values())

    @property
    def needs(self) -> tuple[str, ...]:
        """Fields of Measured that the law cannot do without."""
        return ()

    @classmethod
    @abstractmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return gains that suit a robot, scaled by its inertia at the goal."""

    @property
    def time_span(self) -> float:
        """How long the law goes on changing with time [s]; 0 for a law that does not."""
        return 0.0

    @property
    def phases(self) -> tuple[float, ...]:
        """Times at which another law takes over [s], the first of them 0."""
        return (0.0,)

    def active(self, t: float) -> Controller:
        """Return the law that acts at time t [s]."""
        return self

    def rest_posture(self, t: float) -> Array:
        """Return the posture near which the law rests at time t [s], shape (n,) [rad]: its goal, or the arm's home."""
        posture = self.target_posture(t)
        return self.system.robot.home if posture is None else posture

    def rest_force(self, x: MechanicalState) -> Array | None:
        """Return the f_e under which the law rests, shape (n,) [N·m]; None for a law that rests in free motion."""
        return None

    def contact_stiffness(self, x: MechanicalState) -> Array | None:
        """Return what the law is meant to press on, as a stiffness of the joints, shape (n, n) [N·m/rad].

        It is added to a spring on each joint; None for that alone.
        """
        return None

    def rest_scene(self, x: MechanicalState) -> Scene | None:
        """Return what is to be seen where the law rests; None for a law without eyes."""
        return None

    def random_scene(self, x: MechanicalState, generator: np.random.Generator, spread: float = 1.0) -> Scene | None:
        """Draw something to see from a state, for checks; with a small ``spread`` close to what the law desires.

        None for a law without eyes.
        """
        return None

    def conditions(self, x: MechanicalState, measured: Measured = NOTHING) -> dict[str, float]:
        """Return what the law's claim rests on beside its target, by name: each must be positive at this state."""
        return {}

    def goal_conditions(self) -> dict[str, float]:
        """Return the ``conditions`` at the goal."""
        return {}

    # --- what every law does alike --------------------------------------------------------------

    def initial_state(self, x: MechanicalState) -> Array:
        """Return the controller's state to start with: zero."""
        return np.zeros(self.state_size)

    def target_posture(self, t: float) -> Array | None:
        """Return the posture that the law brings the arm to at time t [s], shape (n,) [rad]; None when it has none."""
        goal = np.asarray(getattr(self, "goal", ()))
        return goal.astype(float) if goal.dtype.kind in "iuf" and goal.shape == (self.system.n,) else None

    def random_state(self, generator: np.random.Generator) -> Array:
        """Draw a controller state, for checks at random states."""
        return generator.normal(size=self.state_size)

    def evaluate(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Command:
        """Return torque and state rate at time t [s]. Pure: same arguments, same command.

        Raises MissingMeasurementError when a needed measurement is None, NonFiniteTorqueError
        instead of ever returning a torque that is not finite.
        """
        law = self.shape(t, x, state, measured)
        force = x.potential_gradient + law.effort
        if law.velocity is not None:
            force -= self._motion(x, law)
        if law.offset_rate is not None:
            force -= x.factor.dot(law.offset_rate)
        if law.cancelled_force is not None:
            force -= law.cancelled_force
        return self._command(t, x, state, force, law.state_rate)

    def _command(self, t: float, x: MechanicalState, state: Array, force: Array, state_rate: Array) -> Command:
        """Return the command whose torque u makes G u the given force [N·m]; it is finite, or not returned."""
        torque = self.system.motor_torque(force)
        if not math.isfinite(torque.dot(torque)) and not np.isfinite(torque).all():
            raise NonFiniteTorqueError(
                self.name, t, torque=torque, position=x.position, velocity=x.velocity, controller_state=state
            )
        return Command(torque, state_rate)

    def _motion(self, x: MechanicalState, law: Shaping) -> Array:
        """Return M ṡ + C s + D s, with C s as the chosen J̄₂ has it [N·m]."""
        s = law.velocity
        assert s is not None
        assert law.acceleration is not None
        force: Array = x.mass_matrix.dot(law.acceleration)
        if self._canonical:
            momentum = s.dot(x.factor)
            force += x.factor.dot(s.dot(x.factor_rate) - x.canonical_interconnection.dot(momentum))
        else:
            force += x.coriolis_matrix.dot(s)
        if x.system.friction is not None:
            force += x.damping * s
        return force

    def _measurement(self, measured: Measured, name: str) -> Array:
        value: Array | None = getattr(measured, name)
        if value is None:
            raise MissingMeasurementError(self.name, name)
        return value

    def _injected_damping(self, x: MechanicalState, damping: Array) -> Array:
        """Return D̄ + ḠCḠᵀ, shape (n, n)."""
        result: Array = x.transformed_damping + x.transformed_input @ damping @ x.transformed_input.T
        return result

    @classmethod
    def check_goal(cls, system: MechanicalSystem, goal: ArrayLike | None) -> Array:
        """Return the goal as an array, or the default one: a posture [rad], by default the robot's home."""
        return system.robot.home if goal is None else vector("goal", goal, system.n)

    @classmethod
    def tuned(
        cls: type[Law],
        system: MechanicalSystem,
        goal: ArrayLike | None = None,
        *,
        interconnection: str = "coriolis",
        **options: Any,
    ) -> Law:
        """Make the law with gains that suit the robot; ``options`` replaces any of them by name.

        Without a goal the law's own choice is used, for most the robot's home. Raises UnknownNameError for a
        misspelt option.
        """
        checked_goal = cls.check_goal(system, goal)
        known = [name for name in inspect.signature(cls).parameters if name not in ("system", "interconnection")]
        for name in options:
            if name not in known:
                raise UnknownNameError("option", name, known, f" of {cls.name}")
        gains = cls.default_gains(system, checked_goal) | options
        return cls(system, interconnection=interconnection, **gains)


def check_loop(controller: object, system: object) -> None:
    """Raise InvalidArgumentError unless these are a Controller and a MechanicalSystem."""
    if not isinstance(controller, Controller):
        raise InvalidArgumentError("controller", f"must be a Controller, but is {type(controller).__name__}")
    check_system(system)


def inertia_scaled_gains(system: MechanicalSystem, goal: Array, frequency: float = 4.0) -> tuple[Array, Array]:
    """Return stiffness [N·m/rad] and damping [N·m·s/rad], one each joint, that suit a robot at a goal.

    K_p = max(ω²M_ii, 0.8 dᵢ(0)) and C = 2 sqrt(K_p M_ii): critically damped at ω [rad/s] or faster, and
    stiff enough that the friction around rest leaves a time constant of about a second.
    """
    x = system.at(goal)
    inertia = np.diag(x.mass_matrix)
    stiffness = np.maximum(frequency**2 * inertia, 0.8 * x.damping)
    return stiffness, 2.0 * np.sqrt(stiffness * inertia)
