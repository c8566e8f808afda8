"""Potentials added up."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.potential import Goal, Potential


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
    def posture(self) -> Array | None:
        """The first that a term knows [rad]."""
        return next((term.posture for term in self.potentials if term.posture is not None), None)

    def check(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError or UnknownNameError when a term does not fit this arm."""
        for term in self.potentials:
            term.check(system)

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
