"""The joint motion along which a frame follows its path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics import kernels
from phcontrol.mechanics.singular_damping import DAMPING_SHARE, LENGTH, SINGULAR_REGION, frame_damping
from phcontrol.mechanics.state import MechanicalState
from phcontrol.trajectories.frame_path import FrameReference

NOTHING: dict[int, Array] = {rows: np.zeros(rows) for rows in (3, 6)}
"""What is missed where nothing is damped, by the rows of a twist; read-only."""
for _zero in NOTHING.values():
    _zero.flags.writeable = False


class ResolvedMotion(NamedTuple):
    """A reference of the joints that moves a frame as its path asks.

    Example:
        >>> from phcontrol import FrameLine, MechanicalSystem, Pose, load_robot, resolved_motion
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.near_home())
        >>> pose = x.placement("tool")
        >>> line = FrameLine("tool", pose, Pose(pose.translation + [0.0, 0.0, 0.05], pose.rotation), travel_time=2.0)
        >>> motion = resolved_motion(x, "tool", line.at(1.0))
        >>> motion.velocity.shape, motion.acceleration.shape
        ((7,), (7,))
    """

    velocity: Array
    """q̇_ref = 𝒥#ξ_d, shape (n,) [rad/s]."""
    acceleration: Array
    """q̈_ref = 𝒥#ξ̇_d + (d𝒥#/dt)ξ_d along the true q̇, shape (n,) [rad/s²]."""
    missed: Array
    """(1 − 𝒥𝒥#)ξ_d, shape (6,) or (3,) [m/s, rad/s]: what the damping leaves out; ``NOTHING`` without."""


def resolved_motion(
    x: MechanicalState,
    frame: str,
    reference: FrameReference,
    *,
    singular_damping: float = DAMPING_SHARE * SINGULAR_REGION,
    singular_region: float = SINGULAR_REGION,
    length: float = LENGTH,
) -> ResolvedMotion:
    """Return the least joint velocity that moves a frame as a reference asks, and its derivative along the motion.

        𝒥# = 𝒥ᵀ(𝒥𝒥ᵀ)⁻¹,   d𝒥#/dt = −𝒥#𝒥̇𝒥# + (1 − 𝒥#𝒥)𝒥̇ᵀ(𝒥𝒥ᵀ)⁻¹,

    𝒥 with the frame's origin and the axes of the world ("local_world_aligned"), along the true q̇ of ``x``. Near
    singularities it is damped: 𝒥# = 𝒥ᵀ(𝒥𝒥ᵀ + λ²W)⁻¹, W = diag(1, 1, 1, 1/ℓ², 1/ℓ², 1/ℓ²), with λ of
    :class:`SingularDamping` and the singular values of 𝒥 with its angular rows times ℓ; λ's rate is in the
    acceleration.
    Where the orientation is left free only the linear rows count.

    Args:
        x: the arm at (q, q̇).
        frame: name of a link or frame of it.
        reference: what the path asks for; its pose is not used.
        singular_damping: λ₀ [m/rad]; 0 for none: then all is NaN, or huge, at a singularity.
        singular_region: ε [m/rad].
        length: ℓ, how many metres 1 rad counts as [m/rad].

    Example:
        >>> import numpy as np
        >>> from phcontrol import FrameLine, MechanicalSystem, Pose, load_robot, resolved_motion
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.near_home())
        >>> pose = x.placement("tool")
        >>> up = Pose(pose.translation + [0.0, 0.0, 0.05], pose.rotation)
        >>> reference = FrameLine("tool", pose, up, travel_time=2.0).at(1.0)
        >>> motion = resolved_motion(x, "tool", reference)
        >>> moved = x.frame_jacobian("tool", "local_world_aligned") @ motion.velocity
        >>> np.allclose(moved, reference.twist, atol=1e-3)
        True
    """
    twist = reference.twist
    rows = len(twist)
    rate = x.frame_kinematics_rate(frame)  # first: it brings 𝒥 along
    rate = rate if rows == len(rate) else rate[:rows]
    task, damping = x.task_space(frame, rows), frame_damping(rows, singular_damping, singular_region, length)
    jacobian, square, asked = task.jacobian, task.square, reference.acceleration
    damped = task.damped if damping is frame_damping(rows) else damping.at(square)
    if damped is None:
        motion = kernels.right_inverse_motion(jacobian, rate, square, None, twist, asked)
        return ResolvedMotion(*motion, NOTHING[rows])
    half = rate.dot(jacobian.T)
    regularised = damping.regularised(square, half + half.T, damped)
    velocity, acceleration = kernels.right_inverse_motion(jacobian, rate, *regularised, twist, asked)
    return ResolvedMotion(velocity, acceleration, twist - jacobian.dot(velocity))


def missed_share(x: MechanicalState, frame: str, rows: int) -> Array:
    """Return 1 − 𝒥𝒥# = λ²W(𝒥𝒥ᵀ + λ²W)⁻¹, shape (rows, rows): what of a twist is missed; 0 where nothing is damped.

    It is that of ``resolved_motion`` as it is by default.
    """
    jacobian = x.frame_jacobian(frame, "local_world_aligned")[:rows]
    square = jacobian.dot(jacobian.T)
    damping = frame_damping(rows)
    damped = damping.at(square)
    if damped is None:
        return np.zeros((rows, rows))
    share: Array = damped[0] * np.linalg.solve(square + damped[0] * damping.weight, damping.weight).T
    return share
