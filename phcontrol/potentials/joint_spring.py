"""A spring on all joints."""

from __future__ import annotations

from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, gain, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.potential import Goal, Potential


class JointSpring(Potential):
    """A spring on all joints: Ψ = ½q̃ᵀK q̃ with q̃ = q − q_d, wrapped to (−π, π] in continuous joints.

    The coordinates are q̃, and A is the identity. In a continuous joint the torque jumps where q̃ passes a half turn.
    Thesis section 3.2.1.

    Args:
        goal: q_d, shape (n,) [rad].
        stiffness: K, scalar, vector or matrix, positive definite [N·m/rad].

    Raises:
        InvalidArgumentError: not finite, of the wrong shape, not symmetric, or not positive definite.

    Example:
        >>> from phcontrol import JointSpring, MechanicalSystem, load_robot
        >>> spring = JointSpring([0.0, 0.5], stiffness=[10.0, 20.0])  # [N·m/rad]
        >>> x = MechanicalSystem(load_robot("pera_shoulder")).at([0.1, 0.5])
        >>> spring.gradient(x), round(spring.energy(x), 3)
        (array([1., 0.]), 0.05)
    """

    def __init__(self, goal: ArrayLike, stiffness: ArrayLike) -> None:
        self.goal = finite_array("goal", goal)
        """q_d, shape (n,) [rad]."""
        if self.goal.ndim != 1 or not self.goal.size:
            raise InvalidArgumentError("goal", f"must be a vector of joint positions, but has shape {self.goal.shape}")
        self.stiffness = gain("stiffness", stiffness, self.goal.size)
        """K, shape (n, n) [N·m/rad]."""

    @property
    def follows(self) -> tuple[str, ...]:
        """Joint positions."""
        return ("joints",)

    @property
    def posture(self) -> Array:
        """q_d [rad]."""
        return self.goal

    def check(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError unless the goal has one entry a joint."""
        vector("goal", self.goal, system.n)

    def energy(self, x: MechanicalState, goal: Goal | None = None) -> float:
        """Return ½q̃ᵀK q̃ [J]."""
        error = self.coordinates(x, goal)
        return float(0.5 * error.dot(self.stiffness.dot(error)))

    def gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return K q̃, shape (n,) [N·m]."""
        error = x.position_error(self.goal if goal is None else goal)  # type: ignore[arg-type]  # joint positions
        gradient: Array = self.stiffness.dot(error)
        return gradient

    def gradient_rate(
        self, x: MechanicalState, velocity: Array, goal: Goal | None = None, missed: Array | None = None
    ) -> Array:
        """Return K v, shape (n,) [N·m/s]."""
        rate: Array = self.stiffness.dot(velocity)
        return rate

    def hessian_along(self, x: MechanicalState, velocity: Array, goal: Goal | None = None) -> Array:
        """Return K v, shape (n,) [N·m/s]."""
        return self.gradient_rate(x, velocity)

    def coordinates(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return q̃, shape (n,) [rad]."""
        return x.position_error(self.goal if goal is None else goal)  # type: ignore[arg-type]  # joint positions

    def coordinate_gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return K q̃, shape (n,) [N·m]."""
        return self.gradient(x, goal)

    def coordinate_map(self, x: MechanicalState, goal: Goal | None = None) -> None:
        """Return None: the identity."""
        return
