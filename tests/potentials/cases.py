"""Potentials of every kind on arms of every kind, and what is compared with differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from phcontrol import (
    FrameSpring,
    FrameWrench,
    GripperSpring,
    JointForce,
    JointSpring,
    MechanicalState,
    MechanicalSystem,
    PointForce,
    Pose,
    PositionPotential,
    Potential,
    SingleJointSpring,
)
from phcontrol.mechanics.potentials import OnJoint
from phcontrol.potentials import Holding
from tests.finite_differences import derivative

FRAMES = {
    "pera": "tool",
    "panda": "panda_hand_tcp",
    "panda_with_fingers": "panda_leftfinger",  # on a prismatic joint, which the other finger mimics
    "kinova": "j2s6s200_end_effector",  # behind continuous joints
    "tiago_no_hand": "arm_7_link",  # behind a prismatic torso
}


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    return pin.exp3(rng.normal(size=3) * rng.uniform(0.2, 2.0))


def random_gain(rng: np.random.Generator, size: int, scale: float) -> np.ndarray:
    root = rng.normal(size=(size, size))
    return scale * (root @ root.T / size + 0.3 * np.eye(size))


def random_pose(rng: np.random.Generator) -> Pose:
    return Pose(rng.uniform(-0.5, 0.5, size=3), random_rotation(rng))


def random_state(system: MechanicalSystem, rng: np.random.Generator) -> MechanicalState:
    return system.at(system.robot.random_position(rng), rng.normal(size=system.n))


def gripper_spring() -> GripperSpring:
    return GripperSpring(closing_stiffness=4.0, opening_stiffness=1.5, rest_angle=0.1, smoothing=0.05)


def joint_spring(system, frame, rng):
    return JointSpring(system.robot.random_position(rng), random_gain(rng, system.n, 20.0))


def single_joint_spring(system, frame, rng):
    return SingleJointSpring(system.robot.joint_names[system.n - 1], 0.1, 7.0)


def joint_force(system, frame, rng):
    return JointForce(rng.normal(size=system.n))


def point_force(system, frame, rng):
    return PointForce(frame, rng.normal(size=3))


def frame_wrench(system, frame, rng):
    return FrameWrench(frame, rng.normal(size=6), orientation=random_rotation(rng))


def frame_spring(system, frame, rng):
    translational, rotational = random_gain(rng, 3, 50.0), random_gain(rng, 3, 5.0)
    return FrameSpring(frame, random_pose(rng), translational_stiffness=translational, rotational_stiffness=rotational)


def point_spring(system, frame, rng):
    return FrameSpring(frame, rng.normal(size=3), translational_stiffness=[50.0, 20.0, 70.0])


def orientation_spring(system, frame, rng):
    return FrameSpring(frame, random_pose(rng), rotational_stiffness=random_gain(rng, 3, 5.0))


def free_spring(system, frame, rng):
    return FrameSpring(
        frame,
        random_pose(rng),
        translational_stiffness=random_gain(rng, 3, 50.0),
        rotational_stiffness=3.0,
        free_direction=rng.normal(size=3),
    )


def holding(system, frame, rng):
    return Holding(frame, random_state(system, rng), rng.normal(size=3), joint=system.robot.joint_names[2])


def position_potential(system, frame, rng):
    return PositionPotential(OnJoint(gripper_spring(), system.n - 1))


def a_sum(system, frame, rng):
    return frame_spring(system, frame, rng) + joint_spring(system, frame, rng) + point_force(system, frame, rng)


Make = Callable[[MechanicalSystem, str, np.random.Generator], Potential]
KINDS: dict[str, Make] = {
    function.__name__: function
    for function in (
        joint_spring,
        single_joint_spring,
        joint_force,
        point_force,
        frame_wrench,
        frame_spring,
        point_spring,
        orientation_spring,
        free_spring,
        holding,
        position_potential,
        a_sum,
    )
}


class Motion:
    """An arm that moves with q̇, and goals that move with q̇_ref: positions in time, and what they give."""

    def __init__(self, x: MechanicalState, frame: str, goal: Pose, start: np.ndarray, rng: np.random.Generator) -> None:
        self.x, self.pose, self.start = x, goal, start
        self.reference = rng.normal(size=x.system.n)
        self.twist = x.frame_jacobian(frame, "local_world_aligned") @ self.reference

    @property
    def error_velocity(self) -> np.ndarray:
        return self.x.velocity - self.reference

    def at(self, t: float) -> MechanicalState:
        return self.x.system.at(self.x.position + t * self.x.velocity, self.x.velocity)

    def goal(self, t: float, kind: str) -> np.ndarray | Pose:
        """A goal whose twist is 𝒥 q̇_ref at t = 0, with 𝒥 of the frame where it is, or whose velocity is q̇_ref."""
        if kind == "joints":
            return self.start + t * self.reference
        linear, angular = self.twist[:3], self.twist[3:]
        return Pose(self.pose.translation + t * linear, pin.exp3(t * angular) @ self.pose.rotation)


def rate_error(actual: np.ndarray, quantity: Callable[[float], np.ndarray]) -> float:
    """How far a rate is from the differences of what it is the rate of, relative to the larger, at least 1."""
    expected = np.asarray(derivative(quantity))
    size = max(1.0, float(np.abs(expected).max(initial=0.0)))
    return float(np.abs(np.asarray(actual) - expected).max(initial=0.0)) / size
