"""Potentials that a law can shape: a desired force, and springs that hold what the force leaves free."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, number, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState


class TaskPotential(Protocol):
    """An energy of the configuration, at a state of the arm."""

    def energy(self, x: MechanicalState) -> float:
        """Return the energy [J]."""
        ...

    def gradient(self, x: MechanicalState) -> Array:
        """Return its derivative with respect to q, shape (n,) [N·m]."""
        ...


class JointForce:
    """f_dᵀq: a constant generalised force f_d [N·m] of the environment on the joints is desired."""

    def __init__(self, force: ArrayLike) -> None:
        self.force = finite_array("force", force)

    def energy(self, x: MechanicalState) -> float:
        """Return f_dᵀq [J]."""
        return float(self.force.dot(x.position))

    def gradient(self, x: MechanicalState) -> Array:
        """Return f_d [N·m]."""
        return self.force

    def lever(self, x: MechanicalState) -> Array:
        """Return how ``force`` acts on the joints, shape (n, n)."""
        return np.eye(self.force.size)


class PointForce:
    """Fᵀr(q): a force F [N, world axes] of the environment on a frame's origin r is desired; f_d = 𝒥_vᵀF."""

    def __init__(self, frame: str, force: ArrayLike) -> None:
        self.frame, self.force = frame, vector("force", force, 3)

    def energy(self, x: MechanicalState) -> float:
        """Return Fᵀr [J]."""
        return float(self.force.dot(x.placement(self.frame).translation))

    def gradient(self, x: MechanicalState) -> Array:
        """Return 𝒥_vᵀF [N·m]."""
        gradient: Array = self.lever(x).dot(self.force)
        return gradient

    def lever(self, x: MechanicalState) -> Array:
        """Return how ``force`` acts on the joints, 𝒥_vᵀ, shape (n, 3)."""
        lever: Array = x.frame_jacobian(self.frame, "local_world_aligned")[:3].T
        return lever


class Holding:
    """Springs on where a frame is across a direction, how it is turned, and where one joint is.

        ½k_t|P(r − r₀)|² + ½k_r|log(R₀ᵀR)|² + ½k_e(q_e − q_e0)²,   P = 1 − n nᵀ

    For an arm that presses along n: everything but the pressing is held, and a redundant arm's elbow too.
    A spring on all joints instead would bias the force.

    Args:
        frame: the frame.
        reference: a state at the posture to be held: gives r₀, R₀, q_e0.
        normal: n, the direction left free, in the world.
        tangential_stiffness: k_t [N/m].
        rotational_stiffness: k_r [N·m/rad]; the frame must stay less than half a turn from R₀.
        joint: the joint to hold, for instance the elbow of a redundant arm; None for none.
        joint_stiffness: k_e [N·m/rad].
    """

    def __init__(
        self,
        frame: str,
        reference: MechanicalState,
        normal: ArrayLike,
        *,
        tangential_stiffness: float = 200.0,
        rotational_stiffness: float = 5.0,
        joint: str | None = None,
        joint_stiffness: float = 5.0,
    ) -> None:
        self.frame = frame
        self.tangential_stiffness = number("tangential_stiffness", tangential_stiffness, minimum=0.0)
        self.rotational_stiffness = number("rotational_stiffness", rotational_stiffness, minimum=0.0)
        self.joint_stiffness = number("joint_stiffness", joint_stiffness, minimum=0.0)
        if not isinstance(reference, MechanicalState):
            raise InvalidArgumentError(
                "reference", f"must be a state of the arm, system.at(position), but is {type(reference).__name__}"
            )
        direction = vector("normal", normal, 3)
        length = float(np.linalg.norm(direction))
        if length < 1e-9:
            raise InvalidArgumentError("normal", "must not be zero")
        self.posture = np.array(reference.position)
        """Where it holds, shape (n,) [rad]."""
        self._across = np.eye(3) - np.outer(direction, direction) / length**2
        place = reference.placement(frame)
        self._origin, self._rotation = np.array(place.translation), np.array(place.rotation)
        self._joint = None if joint is None else reference.system.robot.joint_index(joint)
        self._joint_goal = 0.0 if self._joint is None else float(reference.position[self._joint])

    def energy(self, x: MechanicalState) -> float:
        """Return the energy of the springs [J]."""
        offset, turn = self._deviation(x)
        energy = self.tangential_stiffness * offset.dot(offset) + self.rotational_stiffness * turn.dot(turn)
        if self._joint is not None:
            energy += self.joint_stiffness * (x.position[self._joint] - self._joint_goal) ** 2
        return float(0.5 * energy)

    def gradient(self, x: MechanicalState) -> Array:
        """Return the derivative of the energy [N·m]: log(R₀ᵀR) is its own rotation axis, so no Jacobian of log."""
        offset, turn = self._deviation(x)
        linear = x.frame_jacobian(self.frame, "local_world_aligned")[:3]
        angular = x.frame_jacobian(self.frame, "local")[3:]
        gradient: Array = self.tangential_stiffness * offset.dot(linear) + self.rotational_stiffness * turn.dot(angular)
        if self._joint is not None:
            gradient[self._joint] += self.joint_stiffness * (x.position[self._joint] - self._joint_goal)
        return gradient

    def _deviation(self, x: MechanicalState) -> tuple[Array, Array]:
        place = x.placement(self.frame)
        offset: Array = self._across.dot(place.translation - self._origin)
        turn: Array = pin.log3(self._rotation.T @ place.rotation)
        return offset, turn
