"""A spring on one joint."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array, number, positive, text
from phcontrol.mechanics.robot import wrapped
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.potential import Goal, Potential


class SingleJointSpring(Potential):
    """A spring on one joint: Ψ = ½k q̃_i² with q̃_i = q_i − q_d,i, wrapped to (−π, π] in a continuous joint.

    For the elbow of a redundant arm, where a spring on all joints would pull the hand off. The coordinate is q̃_i.

    Args:
        joint: name of the joint.
        goal: q_d,i [rad], or [m] of a prismatic joint.
        stiffness: k > 0 [N·m/rad], or [N/m].

    Raises:
        InvalidArgumentError: a number is not finite, or the stiffness not positive.

    Example:
        >>> from phcontrol import MechanicalSystem, SingleJointSpring, load_robot
        >>> spring = SingleJointSpring("shoulder_roll", 0.5, stiffness=20.0)  # [N·m/rad]
        >>> spring.gradient(MechanicalSystem(load_robot("pera_shoulder")).at([0.1, 0.75]))
        array([0., 5.])
    """

    def __init__(self, joint: str, goal: float, stiffness: float) -> None:
        self.joint = text("joint", joint)
        self.goal, self.stiffness = number("goal", goal), positive("stiffness", stiffness)

    @property
    def follows(self) -> tuple[str, ...]:
        """Joint positions; its own joint's is taken."""
        return ("joints",)

    def check(self, system: MechanicalSystem) -> None:
        """Raise UnknownNameError unless the arm has the joint."""
        system.robot.joint_index(self.joint)

    def energy(self, x: MechanicalState, goal: Goal | None = None) -> float:
        """Return ½k q̃_i² [J]."""
        error = self._error(x, goal)
        return 0.5 * self.stiffness * error * error

    def gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return k q̃_i in the joint's entry, shape (n,) [N·m]."""
        gradient: Array = np.zeros(x.system.n)
        gradient[x.system.robot.joint_index(self.joint)] = self.stiffness * self._error(x, goal)
        return gradient

    def gradient_rate(
        self, x: MechanicalState, velocity: Array, goal: Goal | None = None, missed: Array | None = None
    ) -> Array:
        """Return k v_i in the joint's entry, shape (n,) [N·m/s]."""
        rate, index = np.zeros(x.system.n), x.system.robot.joint_index(self.joint)
        rate[index] = self.stiffness * velocity[index]
        return rate

    def hessian_along(self, x: MechanicalState, velocity: Array, goal: Goal | None = None) -> Array:
        """Return k v_i in the joint's entry, shape (n,) [N·m/s]."""
        return self.gradient_rate(x, velocity)

    def coordinates(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return q̃_i, shape (1,) [rad]."""
        return np.array([self._error(x, goal)])

    def coordinate_gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return k q̃_i, shape (1,) [N·m]."""
        return np.array([self.stiffness * self._error(x, goal)])

    def coordinate_map(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return the joint's row of the identity, shape (1, n)."""
        row: Array = np.zeros((1, x.system.n))
        row[0, x.system.robot.joint_index(self.joint)] = 1.0
        return row

    def _error(self, x: MechanicalState, goal: Goal | None) -> float:
        robot = x.system.robot
        index = robot.joint_index(self.joint)
        error = x.position[index] - (self.goal if goal is None else goal[index])
        return float(wrapped(error) if robot.continuous[index] else error)

    def __repr__(self) -> str:
        return f"SingleJointSpring({self.joint!r})"
