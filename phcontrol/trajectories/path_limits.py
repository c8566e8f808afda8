"""The path of a frame as slow as the joints need it."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, count, number, per_joint
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.derivatives import right_inverse
from phcontrol.mechanics.singular_damping import LENGTH, SINGULAR_REGION, frame_damping
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.trajectories.frame_path import FramePath, FrameReference, check_frame_path
from phcontrol.trajectories.inverse_kinematics import Posture, UnreachableTargetError
from phcontrol.trajectories.limits import ROUNDING
from phcontrol.trajectories.minimum_jerk import usual_speed
from phcontrol.trajectories.resolved_motion import resolved_motion
from phcontrol.trajectories.slowed_path import SlowedPath

_CORRECTIONS = 8
_ON_PATH = 1e-8
"""How near to the path the joints are brought at each sample [m, rad]."""
_AT_START = 1e-3
"""How far from the path's beginning the start may be [m, rad]."""


def within_limits(
    path: FramePath,
    system: MechanicalSystem,
    start: dict[str, float] | ArrayLike,
    *,
    fraction: float = 0.5,
    acceleration_limit: ArrayLike | None = None,
    singular_region: float = SINGULAR_REGION,
    samples: int = 501,
) -> SlowedPath:
    """Return the path slowed so that no joint exceeds a ``fraction`` of its limits when the arm follows it.

    The arm is led along the path from a posture by q̇ = 𝒥#ξ_d, and kept on it by Newton's method; which way it goes does
    not depend on the speed, so that speeds are divided by the factor and accelerations by its square. Never faster than
    given. A joint without a velocity limit is given 1 rad/s (0.1 m/s if it is prismatic), as in
    :meth:`MinimumJerk.within_limits`. Of a periodic path the first period is looked at; a redundant arm may go
    another way in the next. What happens between two samples is not seen.

    Args:
        path: of a frame, followed from 0 to its duration.
        system: the arm.
        start: where its joints are at 0: an array or angles by joint name [rad]; the frame at the path's beginning.
        fraction: of the limits.
        acceleration_limit: largest joint accelerations, one for all or one each [rad/s²]; None for no limit.
        singular_region: how near to a singularity is too near, σ of :func:`resolved_motion` [m/rad]. Outside of it
            nothing is damped, by default.
        samples: how many instants.

    Raises:
        InvalidArgumentError: the start is elsewhere; the path goes beyond a joint's limits, or too near a singularity,
            as it does where it leaves the workspace; says when.
        UnreachableTargetError: the joints cannot be kept on the path; carries the nearest posture.

    Example:
        >>> from phcontrol import FrameLine, MechanicalSystem, Pose, load_robot, within_limits
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.near_home())
        >>> pose = x.placement("tool")
        >>> up = Pose(pose.translation + [0.0, 0.0, 0.05], pose.rotation)
        >>> fast = FrameLine("tool", pose, up, travel_time=0.1)
        >>> within_limits(fast, system, system.robot.near_home()).duration > 0.1  # as slow as the joints need it [s]
        True
    """
    robot = system.robot
    check_frame_path("path", path, robot)
    share = number("fraction", fraction, minimum=0.0, exclusive=True)
    follower = _Follower(path, system, singular_region)
    position = robot.position(start, "start")
    factor, times = 1.0, np.linspace(0.0, path.duration, count("samples", samples, minimum=2))
    speed = share * usual_speed(robot)
    largest = None if acceleration_limit is None else _limit(acceleration_limit, robot.n)
    away = follower.error(position, path.at(0.0))
    if np.abs(away).max() > _AT_START:
        raise InvalidArgumentError(
            "start",
            f"puts frame '{path.frame}' {np.linalg.norm(away[:3]):.3g} m and {np.linalg.norm(away[3:]):.3g} rad from "
            "where the path begins; reach() finds a posture there",
        )
    for k, t in enumerate(times):
        position = follower.on_path(position, float(t))
        velocity, acceleration = follower.motion(position, float(t))
        factor = max(factor, float((np.abs(velocity) / speed).max()))
        if largest is not None:
            factor = max(factor, math.sqrt(float((np.abs(acceleration) / (share * largest)).max())))
        if k + 1 < len(times):
            position = follower.step(position, float(t), float(times[k + 1] - t))
    return SlowedPath(path, factor)


class _Follower:
    """The arm led along a path."""

    def __init__(self, path: FramePath, system: MechanicalSystem, singular_region: float) -> None:
        self.path, self.system, self.robot = path, system, system.robot
        self.rows = len(path.at(0.0).twist)
        self.damping = frame_damping(self.rows, 0.0, singular_region, LENGTH)

    def error(self, position: Array, reference: FrameReference) -> Array:
        """Return the twist that in unit time brings the frame to a reference, shape (rows,), in the world's axes."""
        here = self.system.at(position).placement(self.path.frame)
        way = reference.position - here.translation
        if reference.rotation is None:
            return np.array(way)
        return np.concatenate([way, pin.log3(reference.rotation @ here.rotation.T)])

    def jacobian(self, position: Array) -> Array:
        """Return the rows of 𝒥 that the path asks for."""
        return self.system.at(position).frame_jacobian(self.path.frame, "local_world_aligned")[: self.rows]

    def on_path(self, position: Array, t: float) -> Array:
        """Return the posture on the path near one. Raises what ``within_limits`` does."""
        reference = self.path.at(t)
        for _ in range(_CORRECTIONS):
            self._check_regular(position, t)
            away = self.error(position, reference)
            if np.abs(away).max() < _ON_PATH:
                break
            position = position + right_inverse(self.jacobian(position)) @ away
        else:
            away = self.error(position, reference)
            posture = Posture(position, float(np.linalg.norm(away[:3])), float(np.linalg.norm(away[3:])))
            raise UnreachableTargetError(self.path.frame, self.robot.name, f" at {t:.3g} s of the path", posture)
        self._check_position(position, t)
        return position

    def motion(self, position: Array, t: float) -> tuple[Array, Array]:
        """Return q̇_ref and q̈_ref."""
        velocity = self.velocity(position, t)
        x = self.system.at(position, velocity)
        return velocity, resolved_motion(x, self.path.frame, self.path.at(t), singular_damping=0.0).acceleration

    def velocity(self, position: Array, t: float) -> Array:
        """Return q̇_ref = 𝒥#ξ_d."""
        return right_inverse(self.jacobian(position)) @ self.path.at(t).twist

    def step(self, position: Array, t: float, step: float) -> Array:
        """Return where q̇ = q̇_ref leads, by a step of Runge and Kutta's method."""
        middle = t + 0.5 * step
        first = self.velocity(position, t)
        second = self.velocity(position + 0.5 * step * first, middle)
        third = self.velocity(position + 0.5 * step * second, middle)
        fourth = self.velocity(position + step * third, t + step)
        return position + step / 6.0 * (first + 2.0 * (second + third) + fourth)

    def _check_regular(self, position: Array, t: float) -> None:
        jacobian = self.jacobian(position)
        distance = self.damping.distance(jacobian @ jacobian.T)
        if not distance >= self.damping.region:
            raise InvalidArgumentError(
                "path",
                f"leads frame '{self.path.frame}' of {self.robot.name} too near a singularity, or out of its "
                f"workspace, at {t:.3g} s: the smallest singular value of its Jacobian is {distance:.3g} m/rad, below "
                f"singular_region = {self.damping.region:g}",
            )

    def _check_position(self, position: Array, t: float) -> None:
        robot = self.robot
        for joint, value, low, high in zip(robot.joint_names, position, robot.lower, robot.upper, strict=True):
            limit = high if value > high else low
            if not low - ROUNDING * max(1.0, abs(low)) <= value <= high + ROUNDING * max(1.0, abs(high)):
                raise InvalidArgumentError(
                    "path", f"takes joint '{joint}' to {value:.3g} at {t:.3g} s, beyond its limit {limit:.3g}"
                )


def _limit(value: ArrayLike, size: int) -> Array:
    limit = per_joint("acceleration_limit", value, size)
    if (limit <= 0.0).any():
        raise InvalidArgumentError("acceleration_limit", "must be > 0")
    return limit
