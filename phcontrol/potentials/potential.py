"""What a potential that a law shapes must state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.pose import Pose
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem

if TYPE_CHECKING:
    from phcontrol.potentials.sum import Sum

Goal: TypeAlias = "Array | Pose"
"""Where a moving reference is: joint positions, shape (n,) [rad], or the pose of a frame (``Pose`` or pin.SE3)."""

_NEWTON_STEPS, _LONGEST_STEP = 60, 0.5  # [rad]
_POSTURES = 4  # at which the directions that are held are counted


class Potential(ABC):
    """An energy Ψ(q), written in coordinates c(q) with ċ = A(q) v, so that ∂Ψ/∂q = Aᵀ∂Ψ/∂c.

    The coordinates are what a law's promise is written in: H_d = ½|p̂|² + Ψ(c) + …. They are errors against a goal,
    and along a goal that moves they change by A v_e, with v_e = q̇ − q̇_ref the velocity error (theory section 11).

    A potential of one's own states ``energy``, ``coordinates``, ``coordinate_gradient``, ``coordinate_map`` and
    ``gradient_rate``; the rest follows. Potentials add up with ``+``, see :class:`Sum`.

    **Goals.** Every method takes a ``goal`` in place of the potential's own, for laws that follow a reference. What
    may be given is said by ``follows``. A ``Sum`` hands a goal to those terms that follow its kind; the others keep
    their own. To a single potential only give what it follows: nothing is checked within a control step.
    """

    @property
    def follows(self) -> tuple[str, ...]:
        """What a goal can be given for: "joints", or a frame's name for its pose; nothing by default."""
        return ()

    @property
    def posture(self) -> Array | None:
        """Joint positions where it is smallest, shape (n,) [rad], if it knows them, else None."""
        return None

    def check(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError or UnknownNameError when it does not fit this arm. By default all fit."""
        return

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
        from phcontrol.potentials.sum import Sum  # a sum is a potential: it is known only when this class is

        if not isinstance(other, Potential):
            return NotImplemented
        return Sum(self, other)

    def __repr__(self) -> str:
        return type(self).__name__


def _rank(rows: Array) -> int:
    return int(np.linalg.matrix_rank(rows, tol=1e-9 * max(1.0, float(np.abs(rows).max())))) if rows.size else 0
