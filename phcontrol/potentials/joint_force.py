"""A constant force on the joints, as a potential."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.potential import Goal, Potential


class JointForce(Potential):
    """A constant generalised force: Ψ = fᵀ(q − q_d), without a goal fᵀq; ∂Ψ/∂q = f.

    A law that shapes it pushes with −f and rests where the environment pushes with f: in force control f is the desired
    force of the environment on the arm (Theorem 4.1.1). It has no minimum. The coordinates are q − q_d, never wrapped.

    Args:
        force: f, one entry a joint [N·m] ([N] of a prismatic joint).

    Raises:
        InvalidArgumentError: not a finite vector.

    Example:
        >>> from phcontrol import JointForce, MechanicalSystem, load_robot
        >>> JointForce([0.0, 2.0]).energy(MechanicalSystem(load_robot("pera_shoulder")).at([0.0, 0.5]))
        1.0
    """

    def __init__(self, force: ArrayLike) -> None:
        self.force = finite_array("force", force)
        """f, shape (n,) [N·m]."""
        if self.force.ndim != 1 or not self.force.size:
            raise InvalidArgumentError("force", f"must be a vector of joint forces, but has shape {self.force.shape}")

    @property
    def follows(self) -> tuple[str, ...]:
        """Joint positions: the energy is counted from them."""
        return ("joints",)

    def check(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError unless the force has one entry a joint."""
        vector("force", self.force, system.n)

    def energy(self, x: MechanicalState, goal: Goal | None = None) -> float:
        """Return fᵀ(q − q_d) [J]."""
        return float(self.force.dot(self.coordinates(x, goal)))

    def gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return f, shape (n,) [N·m]."""
        return self.force

    def gradient_rate(
        self, x: MechanicalState, velocity: Array, goal: Goal | None = None, missed: Array | None = None
    ) -> Array:
        """Return zeros, shape (n,)."""
        return np.zeros_like(self.force)

    def hessian_along(self, x: MechanicalState, velocity: Array, goal: Goal | None = None) -> Array:
        """Return zeros, shape (n,)."""
        return np.zeros_like(self.force)

    def coordinates(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return q − q_d, shape (n,) [rad]."""
        if goal is None:
            return x.position
        offset: Array = x.position - goal
        return offset

    def coordinate_gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return f, shape (n,) [N·m]."""
        return self.force

    def coordinate_map(self, x: MechanicalState, goal: Goal | None = None) -> None:
        """Return None: the identity."""
        return

    def held_directions(self, x: MechanicalState) -> Array:
        """Return no rows."""
        return np.zeros((0, x.system.n))

    def lever(self, x: MechanicalState) -> Array:
        """Return how ``force`` acts on the joints, shape (n, n): ∂Ψ/∂q = lever · force."""
        return np.eye(self.force.size)
