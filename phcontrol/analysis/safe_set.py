"""Starts from which no limit is ever reached: sublevel sets of the storage function."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, count, positive, sequence, vector
from phcontrol.controllers.cartesian_impedance import CartesianImpedance
from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.dynamic_extension import DynamicExtension
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.controllers.integral_action import IntegralAction
from phcontrol.controllers.regulated_law import RegulatedLaw
from phcontrol.controllers.shaped_law import ShapedLaw
from phcontrol.controllers.total_force_rejection import TotalForceRejection
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.least_inertia import least_inertia
from phcontrol.mechanics.weight_slopes import weight_slopes
from phcontrol.potentials.frame_spring import FrameSpring
from phcontrol.potentials.joint_spring import JointSpring
from phcontrol.potentials.potential import Potential
from phcontrol.potentials.single_joint_spring import SingleJointSpring
from phcontrol.safety.limits import Limits

KINDS = ("position", "velocity", "effort")
_LAWS = (
    EnergyShaping, TotalForceRejection, ClassicalImpedance, ForceFeedback, IntegralAction, ImpedanceGrasping,
    CartesianImpedance,
)  # fmt: skip
_SAMPLES = 4000  # of the postures at which inertias are looked at where they are sampled
_SHRUNK, _ROUNDS = 1e-9, 50  # below the level, on which starts are put, and in how many rounds they are found


class _Reach(NamedTuple):
    """How far a law's loop gets with an energy c: q̃_i² ≤ 2c·position_i, q̇_i² ≤ 2c(share·(M⁻¹)_ii + beside_i)."""

    goal: Array
    position: Array
    share: float
    beside: Array


@dataclass(frozen=True, eq=False)
class SafeSet:
    """{H_d ≤ c}: what starts in it stays in it, and inside the limits, while nothing from outside brings in more.

    Made by :func:`safe_set`. For the model of the law, under continuous control and without a ramp.

    Example:
        >>> from phcontrol import MechanicalSystem, load_robot, make_controller, safe_set
        >>> law = make_controller("energy_shaping", MechanicalSystem(load_robot("pera")))
        >>> found = safe_set(law, keep=("position", "velocity"))
        >>> found.margin(law.goal) == found.level == found.levels[found.binding]
        True
    """

    controller: Controller = field(repr=False)
    """The law."""
    level: float
    """c [J]."""
    levels: dict[str, float] = field(repr=False)
    """By limit, like "upper position of elbow": the largest c with which that one is kept [J]."""
    inertia: str
    """Where the bounds of M⁻¹ come from: "certified", or "sampled", which proves nothing."""

    @property
    def binding(self) -> str:
        """The limit that c is the level of."""
        return min(self.levels, key=lambda name: self.levels[name])

    @property
    def certified(self) -> bool:
        """Whether all bounds are proved."""
        return self.inertia == "certified"

    def storage(self, position: ArrayLike, velocity: ArrayLike | None = None, state: ArrayLike | None = None) -> float:
        """Return H_d of a start [J]; of the law's initial state where none is given."""
        law = self.controller
        x = law.system.at(position, np.zeros(law.system.n) if velocity is None else velocity)
        own = law.initial_state(x) if state is None else vector("state", state, law.state_size)
        return float(law.storage(0.0, x, own))

    def margin(self, position: ArrayLike, velocity: ArrayLike | None = None, state: ArrayLike | None = None) -> float:
        """Return c − H_d [J]: how much energy may yet be brought in from outside; negative outside the set."""
        return self.level - self.storage(position, velocity, state)

    def contains(self, position: ArrayLike, velocity: ArrayLike | None = None, state: ArrayLike | None = None) -> bool:
        """Return whether no limit is ever reached from this start."""
        return bool(self.margin(position, velocity, state) >= 0.0)

    def border(self, starts: int, *, seed: int = 0, level: float | None = None) -> tuple[Array, Array, Array]:
        """Draw starts with H_d = c, in all directions: positions, velocities and the law's own states.

        Args:
            starts: how many.
            seed: of the draw.
            level: another c [J].

        Returns:
            Arrays of shapes (starts, n), (starts, n) and (starts, m).
        """
        law, number = self.controller, count("starts", starts)
        energy = self.level if level is None else positive("level", level)
        n, generator = law.system.n, np.random.default_rng(seed)
        spring = _spring(law)
        if not self.storage(spring.goal) < energy:
            raise PHControlError(f"no start has H_d = {energy:.3g} J: the spring on the joints pulls against another")
        stretched = np.linalg.inv(np.linalg.cholesky(spring.stiffness)).T
        inverse = np.linalg.inv(law.system.at(spring.goal).factor).T
        own = _own_units(law, spring.goal)
        rows = [np.zeros((number, size)) for size in (n, n, law.state_size)]
        for k in range(number):
            y = generator.normal(size=2 * n + law.state_size)
            y *= math.sqrt(2.0 * energy) / np.linalg.norm(y)
            way = stretched @ y[:n], inverse @ y[n : 2 * n], own * y[2 * n :]
            scale = _scale(law, spring.goal, way, energy)
            rows[0][k] = spring.goal + scale * way[0]
            rows[1][k], rows[2][k] = scale * way[1], scale * way[2]
        return rows[0], rows[1], rows[2]

    def __str__(self) -> str:
        """Return the level, and the limits that come first."""
        order = sorted(self.levels, key=lambda name: self.levels[name])
        proof = "proved" if self.certified else "from sampled inertias, which prove nothing"
        lines = [f"{self.controller.name}: no limit is reached from H_d ≤ {self.level:.4g} J ({proof})"]
        lines += [f"  {name}: {self.levels[name]:.4g} J" for name in order[:8]]
        return "\n".join(lines)


def safe_set(
    controller: Controller,
    limits: Limits | Literal["robot"] = "robot",
    *,
    keep: ArrayLike = KINDS,
    inertia: Literal["certified", "sampled"] = "certified",
) -> SafeSet:
    """Return the largest sublevel set of H_d inside limits: H_d never grows, so what starts in it stays in it.

    - **Position**: {Ψ ≤ c} of a spring on the joints reaches q̃_i = ±(2c(K_p⁻¹)_ii)^½, exactly: the minimum of Ψ over
      the face q_i = q_max of the limits is ½(q_max − q_d)²/(K_p⁻¹)_ii. Springs that are added can only make it smaller.
    - **Velocity**: q̇_i² ≤ 2c(M⁻¹)_ii of laws with p̂ = p̄; λ_max(1 + A K_zAᵀ) times that of a dynamic extension, and
      2c(K_iK_p⁻¹K_iᵀ)_ii more with integral action. (M⁻¹)_ii is bounded for all postures by :func:`least_inertia`,
      or, with ``inertia="sampled"``, by its largest value at 4000 postures inside the limits.
    - **Effort**, of energy shaping about a spring: the weight at the goal, what it can change by (``weight_slopes``),
      and the largest of −K_pq̃ − C q̇.

    The proof is in docs/which-gains.md.

    Args:
        controller: a law at rest about a spring on the joints: energy shaping, total-force rejection, force feedback,
            integral action, impedance grasping, classical impedance, or Cartesian impedance with a posture spring.
        limits: a :class:`Limits`, or "robot" for those of the law's arm.
        keep: which limits are kept, of "position", "velocity" and "effort".
        inertia: "certified" or "sampled".

    Raises:
        InvalidArgumentError: for a law or a limit of which no bound is proved; says what is.
        PHControlError: the goal itself is outside a limit.

    Example:
        >>> from phcontrol import MechanicalSystem, load_robot, make_controller, safe_set
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> law = make_controller("force_feedback", system)
        >>> found = safe_set(law, keep=("position", "velocity"))
        >>> found.contains(law.goal), found.margin(law.goal) == found.level
        (True, True)
        >>> found.binding
        'velocity of wrist_yaw'
    """
    kinds = _kinds(keep)
    choice("inertia", inertia, ("certified", "sampled"))
    if not isinstance(controller, Controller):
        raise InvalidArgumentError("controller", f"must be a Controller, but is {type(controller).__name__}")
    reach = _reach(controller)
    robot = controller.system.robot
    bounds: Any = robot if limits == "robot" else limits
    if limits != "robot" and not isinstance(limits, Limits):
        raise InvalidArgumentError("limits", f"must be Limits or 'robot', but is {type(limits).__name__}")
    velocity = robot.velocity_limit if limits == "robot" else bounds.velocity
    effort = robot.effort_limit if limits == "robot" else bounds.effort
    mobility = _mobility(controller, inertia) if kinds & {"velocity", "effort"} else np.zeros(robot.n)
    levels: dict[str, float] = {}
    for i, joint in enumerate(robot.joint_names):
        if "position" in kinds and not robot.continuous[i]:
            for end, way in (("lower", reach.goal[i] - bounds.lower[i]), ("upper", bounds.upper[i] - reach.goal[i])):
                levels[f"{end} position of {joint}"] = _level(way, 2.0 * reach.position[i], f"{end} limit of {joint}")
        if "velocity" in kinds:
            speed = 2.0 * (reach.share * mobility[i] + reach.beside[i])
            levels[f"velocity of {joint}"] = _level(float(velocity[i]), speed, f"velocity of {joint}")
    if "effort" in kinds:
        levels |= _effort_levels(controller, reach, effort, mobility)
    levels = {name: value for name, value in levels.items() if math.isfinite(value)}
    if not levels:
        raise InvalidArgumentError("limits", f"are infinite: {robot.name} has none of {', '.join(sorted(kinds))}")
    return SafeSet(controller, min(levels.values()), levels, inertia if kinds & {"velocity", "effort"} else "certified")


def _kinds(keep: Any) -> set[str]:
    names = [keep] if isinstance(keep, str) else list(sequence("keep", keep, "names of limits"))
    for name in names:
        choice("keep", name, KINDS)
    if not names:
        raise InvalidArgumentError("keep", f"is empty: give some of {', '.join(KINDS)}")
    return set(names)


def _level(way: float, rate: float, what: str) -> float:
    """Return the c with way² = rate·c."""
    if not way > 0.0:
        raise PHControlError(f"no set is safe: the {what} is passed at the goal already")
    return float(way**2 / rate) if rate > 0.0 and math.isfinite(way) else math.inf


def _spring(law: Controller) -> JointSpring:
    """Return the spring on the joints that Ψ is, or has beside what is never negative."""
    terms: tuple[Potential | None, ...] = law.potential.terms if isinstance(law, ShapedLaw) else (None,)
    springs = [term for term in terms if isinstance(term, JointSpring)]
    hand = law.hand_spring if isinstance(law, CartesianImpedance) and law.wrench is None else None
    for term in terms:
        if term is not hand and not isinstance(term, (JointSpring, FrameSpring, SingleJointSpring)):
            kind = "nothing" if term is None else type(term).__name__
            raise InvalidArgumentError("controller", f"{law.name} shapes {kind}, of which no least value is known")
    if len(springs) != 1:
        how = ', or posture="spring"' if isinstance(law, CartesianImpedance) else ""
        raise InvalidArgumentError(
            "controller",
            f"{law.name} has {len(springs)} springs on the joints: motions that leave its potential alone reach any "
            f"limit, or none is proved. Give it one{how}",
        )
    return springs[0]


def _reach(law: Controller) -> _Reach:
    if not isinstance(law, _LAWS):
        known = "position laws, Cartesian impedance"
        raise InvalidArgumentError("controller", f"no bound is proved of what {law.name} reaches ({known})")
    if law.time_span or law.reference is not None or (isinstance(law, RegulatedLaw) and law.regulation is not None):
        raise InvalidArgumentError("controller", f"{law.name} is led, or moves its goal: a safe set is about one goal")
    if law.driven_by:
        raise InvalidArgumentError("controller", f"{law.name} is driven by {law.driven_by}")
    spring, n = _spring(law), law.system.n
    slack = np.linalg.inv(spring.stiffness)
    position, share, beside = slack.diagonal().copy(), 1.0, np.zeros(n)
    if isinstance(law, DynamicExtension):
        share += float(np.linalg.eigvalsh(law.coupling @ law.force_gain @ law.coupling.T)[-1])
    if isinstance(law, IntegralAction):
        gain = law.integral_gain
        turned = law.integral_compliance @ spring.stiffness if gain is None else gain
        beside = (turned @ slack @ turned.T).diagonal()
    if isinstance(law, ImpedanceGrasping):
        position += np.linalg.inv(law.rest_stiffness).diagonal()
        beside = spring.stiffness.diagonal()
    return _Reach(spring.goal, position, share, beside)


def _mobility(law: Controller, inertia: str) -> Array:
    """Return a bound of (M⁻¹)_ii for each joint; infinite where nothing is known."""
    system = law.system
    if inertia == "certified":
        least = least_inertia(system)
        if not (least > 0.0).all():
            names = [name for name, value in zip(system.robot.joint_names, least, strict=True) if not value > 0.0]
            raise InvalidArgumentError(
                "inertia", f"of {', '.join(names)} has no proved bound: give inertia='sampled', or keep=('position',)"
            )
        return 1.0 / least
    generator, found = np.random.default_rng(0), np.zeros(system.n)
    for _ in range(_SAMPLES):
        x = system.at(system.robot.random_position(generator))
        found = np.maximum(found, (x.inverse_factor**2).sum(axis=0))
    return found


def _effort_levels(law: Controller, reach: _Reach, effort: Array, mobility: Array) -> dict[str, float]:
    """Return the levels of the motors: |u| ≤ |g(q_d)| + H|q̃| + |K_pq̃| + |C q̇|, potential and kinetic part of c."""
    system, robot = law.system, law.system.robot
    frictionless = isinstance(law, ClassicalImpedance) and system.friction is None and not law.needs
    plain = type(law) is EnergyShaping or frictionless
    if not plain or not isinstance(law.potential, JointSpring) or system.input_matrix is not None or system.potentials:  # type: ignore[attr-defined]
        raise InvalidArgumentError(
            "keep",
            f"no bound is proved of the torque of {law.name} here, but of energy shaping about a spring on the joints, "
            "with gravity and G = 1: give keep=('position', 'velocity')",
        )
    stiffness: Array = law.potential.stiffness  # type: ignore[attr-defined]
    damping = np.abs(law.damping)  # type: ignore[attr-defined]
    weight = np.abs(system.at(reach.goal).potential_gradient)
    slopes = weight_slopes(system)
    stretched: Array = slopes @ np.sqrt(reach.position) + np.sqrt(stiffness.diagonal())
    kinetic: Array = damping @ np.sqrt(mobility)
    rates = 2.0 * (stretched**2 + kinetic**2)
    return {
        f"effort of {joint}": _level(float(effort[i] - weight[i]), float(rates[i]), f"torque of {joint}")
        for i, joint in enumerate(robot.joint_names)
    }


def _own_units(law: Controller, goal: Array) -> Array:
    """Return of each entry of the law's own state what stores ½ J, shape (m,)."""
    x, size = law.system.at(goal), law.state_size
    least = law.storage(0.0, x, np.zeros(size))
    curvature = np.array([2.0 * (law.storage(0.0, x, axis) - least) for axis in np.eye(size)])
    units: Array = np.where(curvature > 0.0, 1.0 / np.sqrt(np.where(curvature > 0.0, curvature, 1.0)), 0.0)
    return units.reshape(size)


def _scale(law: Controller, goal: Array, way: tuple[Array, Array, Array], energy: float) -> float:
    """Return how far along a way from rest H_d has an energy, less a part in 10⁹: it grows nearly by the square."""
    system, aimed = law.system, energy * (1.0 - _SHRUNK)

    def stored(scale: float) -> float:
        return float(law.storage(0.0, system.at(goal + scale * way[0], scale * way[1]), scale * way[2]))

    scale = 1.0
    for _ in range(_ROUNDS):
        found = stored(scale)
        if aimed * (1.0 - _SHRUNK) <= found <= energy:
            return scale
        scale *= math.sqrt(aimed / found)
    low, high = 0.0, scale
    while stored(high) < aimed:
        low, high = high, 2.0 * high
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stored(middle) <= aimed else (low, middle)
    return low
