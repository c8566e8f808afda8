"""The torques that one more body would ask for, linear in its ten parameters."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.state import MechanicalState

PARAMETERS = 10
"""Of a body: mass [kg], first moments [kg m] and second moments Ixx, Ixy, Iyy, Ixz, Iyz, Izz [kg m²] about the origin
of its frame, in the frame's axes."""


def body_torques(x: MechanicalState, frame: str, velocity: Array, acceleration: Array) -> Array:
    """Return Y, shape (n, 10): a body π at a frame adds Yπ to M a + C(q, q̇)s + ∂V/∂q.

    C is that of the Christoffel symbols, so that Y is bilinear and symmetric in q̇ and s. With ω, ω_s the frame's
    angular velocities for q̇ and s, α the mean of its accelerations for the two orders of q̇ and s,

        force = m(α − g) + [α_ω× + ½(ω×ω_s× + ω_s×ω×)] h,   moment = h×(α − g) + I α_ω + ½(ω×I ω_s + ω_s×I ω),

    in the frame's axes. It needs the frame's Jacobian and its rate along q̇ alone.

    Args:
        x: the state of the arm.
        frame: that carries the body.
        velocity: s, shape (n,) [rad/s].
        acceleration: a, shape (n,) [rad/s²].
    """
    rate = x.frame_kinematics_rate(frame)
    _, rotation, jacobian = x.frame_kinematics(frame)
    gravity = np.array(x.system.model.gravity.linear)
    turning, led = jacobian[3:].dot(x.velocity), jacobian[3:].dot(velocity)
    accelerated = jacobian.dot(acceleration) + rate.dot(velocity)
    # the order of q̇ and s matters to ω alone: it differs by ω×ω_s
    linear = rotation.T.dot(accelerated[:3] - gravity)
    angular = rotation.T.dot(accelerated[3:] - 0.5 * _cross(turning).dot(led))
    w, s = rotation.T.dot(turning), rotation.T.dot(led)
    W, S = _cross(w), _cross(s)
    wrench = np.zeros((6, PARAMETERS))
    wrench[:3, 0] = linear
    wrench[:3, 1:4] = _cross(angular) + 0.5 * (W.dot(S) + S.dot(W))
    wrench[3:, 1:4] = -_cross(linear)
    wrench[3:, 4:] = _moments(angular) + 0.5 * (W.dot(_moments(s)) + S.dot(_moments(w)))
    forces: Array = jacobian[:3].T.dot(rotation.dot(wrench[:3])) + jacobian[3:].T.dot(rotation.dot(wrench[3:]))
    return forces


def _cross(a: Array) -> Array:
    """Return the matrix of a×, shape (3, 3)."""
    matrix = np.zeros((3, 3))
    matrix[0, 1], matrix[0, 2], matrix[1, 2] = -a[2], a[1], -a[0]
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = a[2], -a[1], a[0]
    return matrix


def _moments(a: Array) -> Array:
    """Return the matrix that gives I a of the six second moments, shape (3, 6)."""
    matrix = np.zeros((3, 6))
    matrix[0, 0], matrix[0, 1], matrix[0, 3] = a[0], a[1], a[2]
    matrix[1, 1], matrix[1, 2], matrix[1, 4] = a[0], a[1], a[2]
    matrix[2, 3], matrix[2, 4], matrix[2, 5] = a[0], a[1], a[2]
    return matrix


def body_at(robot: Robot, frame: str) -> Array:
    """Return the ten parameters of all that moves with a frame's joint, about the frame, shape (10,)."""
    place = robot.model.frames[robot.frame_id(frame)]
    inertia: pin.Inertia = place.placement.actInv(robot.model.inertias[place.parentJoint])
    return np.array(inertia.toDynamicParameters())
