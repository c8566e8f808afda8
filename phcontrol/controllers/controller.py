"""The base of all laws: the contract, and the one matching formula."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._differences import central_difference
from phcontrol._lazy import lazy
from phcontrol._validation import Array, choice, vector
from phcontrol.controllers.command import Command
from phcontrol.controllers.declared import Declared, Plant
from phcontrol.controllers.parameters import REQUIRED, Parameter
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target, check_target
from phcontrol.controllers.tuning import Tuning
from phcontrol.exceptions import InvalidArgumentError, MissingMeasurementError, NonFiniteTorqueError, UnknownNameError
from phcontrol.mechanics import kernels
from phcontrol.mechanics.state import INTERCONNECTIONS, MechanicalState
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.sensors.measured import NOTHING, Measured, check_needs
from phcontrol.trajectories.trajectory import Trajectory
from phcontrol.vision.scene import Eyes, Scene

Law = TypeVar("Law", bound="Controller")

_finite_copy = kernels.finite_copy
_SHIFT_TOLERANCE = 1e-9  # of what p̂ is made of: a θ that does not depend on q̇ leaves rounding
_AT_REST = 1e-3  # √J: below which a momentum may be what is left of larger numbers
_STEP = 1e-3  # of the arm's motion [rad], over which θ is differentiated where a law does not state its rate


class Controller(Declared, ABC):
    """A law of energy-based control. Stateless: gains are fixed and checked when it is made.

    A law states what it promises: its ``storage`` function H_d and its ``target``, the port-Hamiltonian system that
    the closed loop will be. Torque, rate of its own state and passive port follow. With the adapted momentum
    p̂ = p̄ + θ(q, own state, t), which is the part "momentum" of the target, and F★ its promised rate,

        u = G⁻¹T[F★ − θ̇ + T⁻¹∂V/∂q − (J̄₂ − D̄)p̄ − T⁻¹f_known].

    A law may beside that ``shape`` in closed form what is derived otherwise, because it is faster; tests hold the two
    against each other. For ``interconnection="coriolis"`` the formula then reads
    u = G⁻¹[∂V/∂q − M ṡ − C s − D s − T ϑ̇ + effort − f_known], for "canonical" (the thesis's J̄₂)
    C s is replaced by T(Ṫᵀs) − T J̄₂Tᵀs.

    Laws with s = 0 give the same torque for both, since both J̄₂ agree on p̄; their targets differ.

    Arguments are declared as :class:`Parameter`, and checked by it; ``system`` is the model that the law computes
    with; the plant it is tried on may be another.

    Example:
        >>> import numpy as np
        >>> from phcontrol import Controller, Gain, MechanicalSystem, Target, Vector, certify, load_robot
        >>> class Spring(Controller):
        ...     name = "spring"
        ...     goal: Vector = Vector("q_d", "rad")
        ...     stiffness: Gain = Gain("K_p", "N·m/rad")
        ...     damping: Gain = Gain("C", "N·m·s/rad")
        ...
        ...     def storage(self, t, x, state, measured=None):
        ...         error = x.position_error(self.goal)
        ...         return x.kinetic_energy + 0.5 * error @ self.stiffness @ error
        ...
        ...     def target(self, t, x, state, measured=None):
        ...         error = x.position_error(self.goal)
        ...         return Target.mechanical(
        ...             x, self.interconnection, error=error, gradient=self.stiffness @ error, damping=self.damping
        ...         )
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> certify(Spring(system, goal=[0.1, 0.5], stiffness=20.0, damping=5.0)).verdict
        'PASSED'
    """

    name: ClassVar[str]
    """The law's name on the command line."""
    forms: ClassVar[tuple[str, ...]] = INTERCONNECTIONS
    """The choices of J̄₂ that the law knows."""
    run: ClassVar[str] = "position"
    """The run that the law belongs to, ``phcontrol run position`` or another: what it brings to its goal."""
    jumps: ClassVar[bool] = False
    """Whether the law's own state may jump (``jump``)."""
    system: Plant = Plant(kw_only=False)
    interconnection: Parameter[str, str] = Parameter("J̄₂", default="coriolis", check=lambda name, value, system: value)

    if not TYPE_CHECKING:  # for type checkers it follows from the declarations

        def __init__(self, system: MechanicalSystem, **arguments: Any) -> None:
            if not isinstance(getattr(self, "name", None), str):
                raise InvalidArgumentError("name", f'of {type(self).__name__} is missing: a law needs name = "..."')
            choice("interconnection", arguments.get("interconnection", INTERCONNECTIONS[0]), self.forms)
            super().__init__(system, **arguments)

    # --- what a law states ----------------------------------------------------------------------

    @abstractmethod
    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return the storage function H_d at time t [s], in a state of the arm and of the law [J]."""

    @abstractmethod
    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the promised closed loop at one state."""

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the parts of the law's own state, in their order; each is a part of the target too."""
        return ()

    @property
    def needs(self) -> tuple[str, ...]:
        """Fields of Measured that the law cannot do without."""
        return ()

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

    @property
    def other_rests(self) -> str:
        """Why H_d may be as low at other postures as at the goal; empty where the goal alone is its minimum."""
        return ""

    # --- what follows from that; a law may state it in closed form instead -------------------------

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """Return the desired dynamics of p̂; here derived from the target, θ̇ by finite differences along the flow.

        Raises InvalidArgumentError where p̂ − p̄ depends on q̇: then the torque does not follow from the target so.
        """
        force = self._felt(x, measured)
        target = self.target(t, x, state, measured)
        check_target(target, type(self))
        rate = target.rate(force)
        state_rate = self._own(target, rate)
        h = _STEP / max(1.0, float(np.abs(x.velocity).max(initial=0.0)))

        def shift(step: float) -> Array:
            """Return θ a little along the flow: p̂ of an arm at rest there."""
            there = x.system.at(x.position + step * x.velocity)
            later = self.measured_along(x, measured, step)
            return self.target(t + step, there, state + step * state_rate, later).momentum

        self._check_shift(x, target.momentum, shift(0.0))
        effort = rate[target.parts[MOMENTUM]] - central_difference(shift, h) - x.transformed_rate(np.zeros(x.system.n))
        return Shaping(x.factor.dot(effort), cancelled_force=force, state_rate=state_rate)

    def _check_shift(self, x: MechanicalState, momentum: Array, shift: Array) -> None:
        """Raise InvalidArgumentError unless p̂ is p̄ plus what it is of an arm at rest, θ."""
        if momentum.shape != (x.system.n,):
            raise InvalidArgumentError(
                "target", f"of {self.name} must have a momentum of shape ({x.system.n},), but it has {momentum.shape}"
            )
        change = np.abs(momentum - x.transformed_momentum - shift)
        scale = np.abs(momentum) + np.abs(x.transformed_momentum) + np.abs(shift)
        if change.max(initial=0.0) > _SHIFT_TOLERANCE * max(float(scale.max(initial=0.0)), _AT_REST):
            raise InvalidArgumentError(
                "target",
                f"of {self.name} must have the momentum p̂ = p̄ + θ(q, state, t), p̄ = x.transformed_momentum, but "
                f"p̂ − p̄ changes with q̇, by up to {change.max():.2g}. Take the velocity out of it, or state shape()",
            )

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return the coordinates x that the target is written in."""
        return self.target(t, x, state, measured).coordinates

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return ŷ = GᵀT⁻ᵀ∂H_d/∂p̂, the power ∇H_dᵀR_d∇H_d that the promise dissipates, and the force for it.

        A torque δ more than the law's brings in ŷᵀδ. The force is T(R_d∇H_d)[p̂]: of the coordinates p̂ alone depends on
        q̇, by Tᵀ.
        """
        target = self.target(t, x, state, measured)
        losses, y = target.dissipation.dot(target.gradient), self.promised_state(x)
        output = y.input_matrix.T.dot(y.solve_factor_transposed(target.gradient[target.parts[MOMENTUM]]))
        resistance: Array = y.factor.dot(losses[target.parts[MOMENTUM]])
        return PassivePort(output, float(target.gradient.dot(losses)), resistance)

    def promised_state(self, x: MechanicalState) -> MechanicalState:
        """Return the state as the arm has it that the promise is about: x, but where a law is told of another arm."""
        return x

    def measured_along(self, x: MechanicalState, measured: Measured, step: float) -> Measured:
        """Return what will be measured ``step`` seconds on [s], while the arm moves on and forces stay."""
        return measured

    def _felt(self, x: MechanicalState, measured: Measured) -> Array | None:
        """Return f_e [N·m] where the law needs it."""
        if "external_force" in self.needs:
            return self._measurement(measured, "external_force")
        if "total_force" in self.needs:
            return self._measurement(measured, "total_force") - x.total_force()
        return None

    def _own(self, target: Target, rate: Array) -> Array:
        """Return the rows of the law's own state."""
        for name, size in self.state_parts.items():
            if name not in target.parts:
                raise InvalidArgumentError(
                    "target", f"of {self.name} has no part '{name}', which is a state of it; it has {_listed(target)}"
                )
            part = target.parts[name]
            if part.stop - part.start != size:
                raise InvalidArgumentError(
                    "target", f"of {self.name}: part '{name}' must have length {size}, but has {part.stop - part.start}"
                )
        return np.concatenate([np.zeros(0), *(rate[target.parts[name]] for name in self.states)])

    # --- the law's own state ------------------------------------------------------------------------

    @property
    def state_parts(self) -> dict[str, int]:
        """Lengths of the parts of the law's own state, by name, in their order: one number for each joint."""
        return dict.fromkeys(self.states, self.system.n)

    @lazy
    def state_size(self) -> int:
        """Length of the law's own state."""
        return sum(self.state_parts.values())

    def initial_state(self, x: MechanicalState) -> Array:
        """Return the controller's state to start with: zero."""
        return np.zeros(self.state_size)

    def jump(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return the law's own state after what happens at once at time t [s]: asked before each step of a loop.

        The same for all laws but those that switch on events (``jumps``).
        """
        return state

    def random_state(self, generator: np.random.Generator) -> Array:
        """Draw a controller state, for checks at random states."""
        return generator.normal(size=self.state_size)

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return the law's own state that makes H_d smallest at a state of the arm; the same if it has no such form.

        Where limits hold the arm back, moving the law's state towards it takes energy out of H_d again: a state that
        integrates forces does not wind up.
        """
        return state

    def rate_under_limits(
        self, t: float, x: MechanicalState, state: Array, rate: Array, change: Array, measured: Measured = NOTHING
    ) -> Array:
        """Return the rate of the law's own state where the torque that acts is the law's plus a change [N·m]."""
        return rate

    # --- where and when it rests --------------------------------------------------------------------

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

    def target_posture(self, t: float) -> Array | None:
        """Return the posture that the law brings the arm to at time t [s], shape (n,) [rad]; None when it has none.

        It is the law's ``goal`` where that is a posture.
        """
        goal = np.asarray(getattr(self, "goal", None))
        return goal.astype(float) if goal.dtype.kind in "iuf" and goal.shape == (self.system.n,) else None

    def desired_posture(self, t: float, state: Array) -> Array | None:
        """Return the posture that the law desires at time t [s] in a state of its own, shape (n,) [rad]; None for none.

        What a law that takes over can begin with, so that what is desired does not jump.
        """
        return self.target_posture(t)

    def rest_posture(self, t: float) -> Array:
        """Return the posture near which the law rests at time t [s], shape (n,) [rad]: its goal, or the arm's home."""
        posture = self.target_posture(t)
        return self.system.robot.home if posture is None else posture

    def reference_velocity(self, t: float, x: MechanicalState) -> Array:
        """Return the velocity that the law leads the arm along with at time t [s], shape (n,) [rad/s]; 0 for none.

        Here that of the posture where it rests.
        """
        if not self.time_span:
            return np.zeros(self.system.n)
        velocity: Array = central_difference(lambda step: self.rest_posture(t + step), _STEP)
        return velocity

    @property
    def led_along(self) -> Trajectory | None:
        """The trajectory of the joints that the law leads the arm along; None for none."""
        return None

    @property
    def unheld(self) -> Controller:
        """The law that a certificate is about: itself, unless it reckons with torques that are held."""
        return self

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

    @property
    def eyes(self) -> Eyes | None:
        """What a law with a camera sees by; None for a law without eyes."""
        return None

    @property
    def injected_damping(self) -> Array | None:
        """C, shape (n, n) [N·m·s/rad], of a law whose injected damping is −C ŷ; None of others."""
        return None

    def joint_damping(self, t: float, x: MechanicalState) -> Array | None:
        """Return what the law injects as a damping of the joints, G C Gᵀ, shape (n, n); None where it has no such form.

        Power v̂ᵀG C Gᵀv̂ is what an energy tank is filled from.
        """
        return None

    @property
    def longest_period(self) -> float:
        """Of a control loop with which the law's own state keeps its bounds [s]; infinite for most laws."""
        return math.inf

    def tank_level(self, state: Array) -> float | None:
        """Return the energy in the law's tank [J]; None for a law without one."""
        return None

    def conditions(self, x: MechanicalState, measured: Measured = NOTHING) -> dict[str, float]:
        """Return what the law's claim rests on beside its target, by name: each must be positive at this state."""
        return {}

    # --- what every law does alike --------------------------------------------------------------

    def evaluate(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Command:
        """Return torque and state rate at time t [s]. Pure: same arguments, same command.

        Raises MissingMeasurementError when a needed measurement is None, NonFiniteTorqueError
        instead of ever returning a torque that is not finite.
        """
        law = self.shape(t, x, state, measured)
        force = law.effort if law.complete else x.potential_gradient + law.effort
        if law.velocity is not None:
            force -= self._motion(x, law)
        if law.offset_rate is not None:
            force -= x.factor.dot(law.offset_rate)
        if law.cancelled_force is not None:
            force -= law.cancelled_force
        torque = _finite_copy(x.motor_torque(force), self.system.n)
        if torque is None:
            raise NonFiniteTorqueError(
                self.name, t, torque=x.motor_torque(force), position=x.position, velocity=x.velocity,
                controller_state=state,
            )  # fmt: skip
        return Command(torque, law.state_rate)

    def _motion(self, x: MechanicalState, law: Shaping) -> Array:
        """Return M ṡ + C s + D s, with C s as the chosen J̄₂ has it [N·m]."""
        s = law.velocity
        assert s is not None
        assert law.acceleration is not None
        force: Array = x.mass_matrix.dot(law.acceleration)
        if self.interconnection == "canonical":
            momentum = s.dot(x.factor)
            force += x.factor.dot(s.dot(x.factor_rate) - x.canonical_interconnection.dot(momentum))
        else:
            force += x.coriolis_matrix.dot(s)
        if x.system.friction is not None:
            force += x.resistance(s)
        return force

    def _measurement(self, measured: Measured, name: str) -> Array:
        value: Array | None = getattr(measured, name)
        if value is None:
            raise MissingMeasurementError(self.name, name)
        return value

    # --- gains that suit a robot ----------------------------------------------------------------

    @classmethod
    def check_goal(cls, system: MechanicalSystem, goal: ArrayLike | None) -> Array:
        """Return the goal as an array, or the default one: a posture [rad], by default the robot's home."""
        return system.robot.home if goal is None else vector("goal", goal, system.n)

    @classmethod
    def tuning(cls, system: MechanicalSystem, goal: Array, **desired: float | None) -> Tuning:
        """Return what the default gains are made from, with the arm's inertia at the goal; ``desired`` as there."""
        return Tuning(system, goal, goal, **desired)

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return gains that suit a robot, scaled by its inertia (:class:`Tuning`).

        Args:
            system: the model of the arm.
            goal: as ``check_goal`` returns it.
            given: arguments that are chosen otherwise, by name.
            desired: ``bandwidth`` [rad/s] and ``damping_ratio``.
        """
        tuning = cls.tuning(system, goal, **desired)
        made = {
            name: parameter.tuned(tuning)
            for name, parameter in cls.parameters.items()
            if parameter.tuned is not None and name not in given
        }
        own_goal = cls.parameters.get("goal")
        if own_goal is not None and own_goal.default is REQUIRED and own_goal.tuned is None and "goal" not in given:
            made["goal"] = goal  # what is asked for is never dropped
        return made

    @classmethod
    def tuned(
        cls: type[Law],
        system: MechanicalSystem,
        goal: ArrayLike | None = None,
        *,
        bandwidth: float | None = None,
        damping_ratio: float | None = None,
        **options: Any,
    ) -> Law:
        """Make the law with gains that suit the robot; ``options`` replaces any of its arguments by name.

        Without a goal the law's own choice is used, for most the robot's home. Raises UnknownNameError for a
        misspelt option.

        Args:
            system: the model of the arm.
            goal: for most laws a posture [rad].
            bandwidth: the desired ω [rad/s]: exact at the goal, instead of gains for all postures (:class:`Tuning`).
            damping_ratio: the desired ζ, likewise.
            options: arguments of the constructor.
        """
        check_system(system)
        for name in options:
            if name not in cls.parameters:
                known = [known for known in cls.parameters if known != "interconnection"]
                raise UnknownNameError("option", name, known, f" of {cls.name}")
        checked_goal = cls.check_goal(system, goal)
        gains = cls.default_gains(system, checked_goal, given=options, bandwidth=bandwidth, damping_ratio=damping_ratio)
        for name, parameter in cls.parameters.items():
            if parameter.default is REQUIRED and name not in gains and name not in options:
                raise InvalidArgumentError(
                    name, f"of {cls.name} has no value for this arm: give one, or declare it with tuned= or default="
                )
        return cls(system, **(gains | options))


def _listed(target: Target) -> str:
    return ", ".join(f"'{name}'" for name in target.parts) or "no named parts"


def check_loop(controller: object, system: object) -> None:
    """Raise InvalidArgumentError unless these are a Controller, with needs that exist, and a MechanicalSystem."""
    if not isinstance(controller, Controller):
        raise InvalidArgumentError("controller", f"must be a Controller, but is {type(controller).__name__}")
    if not isinstance(getattr(controller, "system", None), MechanicalSystem):
        message = f"must have a system: the constructor of {type(controller).__name__} must call that of Controller"
        raise InvalidArgumentError("controller", message)
    check_needs(type(controller).__name__, controller.needs)
    check_system(system)
