"""What a potential that a law shapes must state, and how potentials add up."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeAlias

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.pose import Pose
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem

Goal: TypeAlias = "Array | Pose"
"""Where a moving reference is: joint positions, shape (n,) [rad], or the pose of a frame (``Pose`` or pin.SE3)."""

_NEWTON_STEPS, _LONGEST_STEP = 60, 0.5  # [rad]
_BESIDE, _LEVEL = 0.1, 1e-6  # of its posture [rad], and of the gradient there: what may be left of one at its posture
_POSTURES = 4  # at which the directions that are held are counted


class Potential(ABC):
    """An energy Ψ(q), written in coordinates c(q) with ċ = A(q) v, so that ∂Ψ/∂q = Aᵀ∂Ψ/∂c.

    The coordinates are what a law's promise is written in: H_d = ½|p̂|² + Ψ(c) + …. They are errors against a goal,
    and along a goal that moves they change by A v_e, with v_e = q̇ − q̇_ref the velocity error (docs/theory.md).

    A potential of one's own states ``energy``, ``coordinates``, ``coordinate_gradient``, ``coordinate_map`` and
    ``gradient_rate``; the rest follows. Potentials add up with ``+``, see :class:`Sum`.

    **Goals.** Every method takes a ``goal`` in place of the potential's own, for laws that follow a reference. What
    may be given is said by ``follows``. A ``Sum`` hands a goal to those terms that follow its kind; the others keep
    their own. To a single potential only give what it follows: nothing is checked within a control step.

    Example:
        >>> from phcontrol import JointForce, JointSpring, MechanicalSystem, Potential, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> both = JointSpring([0.0, 0.0], 20.0) + JointForce([1.0, 0.0])
        >>> x = system.at([0.1, 0.0])
        >>> isinstance(both, Potential), both.gradient(x)
        (True, array([3., 0.]))
    """

    @property
    def follows(self) -> tuple[str, ...]:
        """What a goal can be given for: "joints", or a frame's name for its pose; nothing by default."""
        return ()

    @property
    def terms(self) -> tuple[Potential, ...]:
        """What it is the sum of: itself, where it is no sum."""
        return (self,)

    @property
    def posture(self) -> Array | None:
        """Joint positions where it is smallest, shape (n,) [rad], if it knows them, else None."""
        return None

    def check(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError or UnknownNameError when it does not fit this arm. By default all fit."""
        return

    def check_posture(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError when it says that it is smallest at a posture, and it has a slope there."""
        if self.posture is None:
            return
        there, beside = (np.abs(self.gradient(system.at(self.posture + way))).max() for way in (0.0, _BESIDE))
        if there > _LEVEL * beside:
            raise InvalidArgumentError(
                "potential",
                f"says that it is smallest at {np.array2string(self.posture, precision=4)}, but there its gradient is "
                f"up to {there:.3g} N·m: {self!r} must have its minimum where posture says",
            )

    @abstractmethod
    def energy(self, x: MechanicalState, goal: Goal | None = None) -> float:
        """Return Ψ [J]."""

    @abstractmethod
    def coordinates(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return c, shape (k,)."""

    @abstractmethod
    def coordinate_gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return ∂Ψ/∂c, shape (k,)."""

    @abstractmethod
    def coordinate_map(self, x: MechanicalState, goal: Goal | None = None) -> Array | None:
        """Return A, shape (k, n); None for the identity."""

    def twist_map(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return how c changes with a twist of the frame that it follows, world axes, shape (k, 6); 0 if none."""
        return np.zeros((len(self.coordinates(x, goal)), 6))

    @abstractmethod
    def gradient_rate(
        self, x: MechanicalState, velocity: Array, goal: Goal | None = None, missed: Array | None = None
    ) -> Array:
        """Return d/dt of ∂Ψ/∂q, shape (n,) [N·m/s], while c changes by A times a velocity and the arm moves with q̇.

        Ȧᵀ∂Ψ/∂c + Aᵀ(∂²Ψ/∂c²)A v: x.velocity, the true q̇, turns Jacobians and frames; ``velocity`` v [rad/s] is
        v_e = q̇ − q̇_ref along a goal that moves, and q̇ for one at rest. ``missed`` is what q̇_ref lacks of the goal's
        twist near a singularity, in the axes of the world (``ResolvedMotion``).
        """

    def gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return ∂Ψ/∂q = Aᵀ∂Ψ/∂c, shape (n,) [N·m]."""
        map_, gradient = self.coordinate_map(x, goal), self.coordinate_gradient(x, goal)
        return gradient if map_ is None else gradient.dot(map_)

    def hessian_along(self, x: MechanicalState, velocity: Array, goal: Goal | None = None) -> Array:
        """Return (∂²Ψ/∂q²)v for any velocity v [rad/s] and a goal at rest, shape (n,) [N·m/s]."""
        moving = x if velocity is x.velocity else x.system.at(x.position, velocity)
        return self.gradient_rate(moving, velocity, goal)

    def minimum_near(self, system: MechanicalSystem, start: Array, goal: Goal | None = None) -> Array:
        """Return joint positions near a start at which Ψ is smallest, shape (n,) [rad], or the start where it has none.

        Newton's steps, shortened until Ψ falls, that leave alone what Ψ does not hold.
        """
        position, x = np.array(start, dtype=float), system.at(start)
        energy = self.energy(x, goal)
        for _ in range(_NEWTON_STEPS):
            gradient = self.gradient(x, goal)
            hessian = np.stack([self.hessian_along(x, unit, goal) for unit in np.eye(system.n)])
            values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
            size = np.abs(values)
            held = size > 1e-9 * size.max(initial=0.0)
            if not held.any():
                return np.array(start, dtype=float)
            step = vectors[:, held] @ ((vectors[:, held].T @ gradient) / size[held])
            step *= min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-300))
            if np.abs(step).max() < 1e-13:
                break
            while True:
                there = system.at(position - step)
                if self.energy(there, goal) <= energy or np.abs(step).max() < 1e-13:
                    break
                step = 0.5 * step
            position, x, energy = there.position, there, self.energy(there, goal)
        return position

    def held_directions(self, x: MechanicalState) -> Array:
        """Return a (m, n) matrix whose rows say along which velocities Ψ has a minimum: all that c moves along.

        Only its rank is asked for. A force, which has none, returns no rows.
        """
        map_ = self.coordinate_map(x)
        return np.eye(x.system.n) if map_ is None else map_

    def lacks_minimum(self, system: MechanicalSystem) -> str:
        """Return "" when Ψ has a strict minimum in q on this arm, else in words why it has none.

        Counted is how many directions springs hold, at several postures. A force that is stronger than the springs, or
        a goal in a singular posture, is not seen.
        """
        generator = np.random.default_rng(0)
        states = (system.at(system.robot.random_position(generator, margin=0.1)) for _ in range(_POSTURES))
        held = max(_rank(self.held_directions(x)) for x in states)
        if held == system.n:
            return ""
        if held == 0:
            return f"{self!r} has no minimum: no spring is in it"
        return f"{self!r} holds {held} of the {system.n} directions in which the joints move, and no others"

    def __add__(self, other: Potential) -> Sum:
        """Return the sum; sums of sums are flat."""
        if not isinstance(other, Potential):
            return NotImplemented
        return Sum(self, other)

    def __repr__(self) -> str:
        return type(self).__name__


class Sum(Potential):
    """Ψ = Σ Ψ_i, in the coordinates of all its terms, one after the other. Written ``first + second``.

    A goal goes to the terms that follow its kind: joint positions to all that follow "joints"; a pose to all that
    follow a frame, and where they follow several, to those of the first such term's frame. The other terms keep their
    own goals, at rest, and their gradients change by x.velocity.

    Args:
        potentials: the terms; sums among them are taken apart.

    Raises:
        InvalidArgumentError: a term is no potential.

    Example:
        >>> from phcontrol import JointForce, JointSpring
        >>> JointSpring([0.0, 0.5], stiffness=10.0) + JointForce([1.0, 0.0])
        JointSpring + JointForce
    """

    def __init__(self, *potentials: Potential) -> None:
        terms: list[Potential] = []
        for potential in potentials:
            if not isinstance(potential, Potential):
                raise InvalidArgumentError("potentials", f"must be potentials, but one is {type(potential).__name__}")
            terms.extend(potential.potentials if type(potential) is Sum else (potential,))
        self.potentials: tuple[Potential, ...] = tuple(terms)
        """The terms."""
        frames = [name for term in terms for name in term.follows if name != "joints"]
        self._frame = frames[0] if frames else None
        self._follow_joints = tuple("joints" in term.follows for term in terms)
        self._follow_frame = tuple(self._frame in term.follows for term in terms)

    @property
    def follows(self) -> tuple[str, ...]:
        """The frame that a pose is taken for, if any term follows one, and "joints" if any follows those."""
        frame = () if self._frame is None else (self._frame,)
        return (*frame, "joints") if any(self._follow_joints) else frame

    @property
    def terms(self) -> tuple[Potential, ...]:
        """The potentials that are added."""
        return self.potentials

    @property
    def posture(self) -> Array | None:
        """The first that a term knows [rad]."""
        return next((term.posture for term in self.potentials if term.posture is not None), None)

    def check(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError or UnknownNameError when a term does not fit this arm."""
        for term in self.potentials:
            term.check(system)

    def check_posture(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError when a term has a slope where it says that it is smallest; the sum may."""
        for term in self.potentials:
            term.check_posture(system)

    def energy(self, x: MechanicalState, goal: Goal | None = None) -> float:
        """Return Σ Ψ_i [J]."""
        return sum((term.energy(x, own) for term, own in self._with_goals(goal)), 0.0)

    def gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return Σ ∂Ψ_i/∂q, shape (n,) [N·m]."""
        total: Array = np.zeros(x.system.n)
        for term, own in self._with_goals(goal):
            total += term.gradient(x, own)
        return total

    def gradient_rate(
        self, x: MechanicalState, velocity: Array, goal: Goal | None = None, missed: Array | None = None
    ) -> Array:
        """Return the sum of the rates, shape (n,) [N·m/s]; v = q̇ in terms that do not follow the goal."""
        total: Array = np.zeros(x.system.n)
        for term, own in self._with_goals(goal):
            follows = goal is None or own is not None
            total += term.gradient_rate(x, velocity if follows else x.velocity, own, missed if follows else None)
        return total

    def coordinates(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return the coordinates of all terms, shape (k,)."""
        return np.concatenate([np.zeros(0), *(term.coordinates(x, own) for term, own in self._with_goals(goal))])

    def coordinate_gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return ∂Ψ/∂c, shape (k,)."""
        return np.concatenate(
            [np.zeros(0), *(term.coordinate_gradient(x, own) for term, own in self._with_goals(goal))]
        )

    def coordinate_map(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return A, shape (k, n)."""
        n = x.system.n
        maps = [term.coordinate_map(x, own) for term, own in self._with_goals(goal)]
        return np.concatenate([np.zeros((0, n)), *(np.eye(n) if map_ is None else map_ for map_ in maps)])

    def twist_map(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return the maps of the terms that follow a frame, 0 for the others, shape (k, 6)."""
        return np.concatenate([np.zeros((0, 6)), *(term.twist_map(x, own) for term, own in self._with_goals(goal))])

    def held_directions(self, x: MechanicalState) -> Array:
        """Return the directions that any term holds."""
        return np.concatenate([np.zeros((0, x.system.n)), *(term.held_directions(x) for term in self.potentials)])

    def _with_goals(self, goal: Goal | None) -> list[tuple[Potential, Goal | None]]:
        """Return each term and the goal it is given."""
        if goal is None:
            return [(term, None) for term in self.potentials]
        follow = self._follow_joints if isinstance(goal, np.ndarray) else self._follow_frame
        return [(term, goal if takes else None) for term, takes in zip(self.potentials, follow, strict=True)]

    def __repr__(self) -> str:
        return " + ".join(map(repr, self.potentials)) or "Sum()"


def _rank(rows: Array) -> int:
    return int(np.linalg.matrix_rank(rows, tol=1e-9 * max(1.0, float(np.abs(rows).max())))) if rows.size else 0
