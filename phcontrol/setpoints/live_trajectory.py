"""A posture that may be changed while an arm runs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, number, per_joint, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.setpoints.jerk_limited_course import JerkLimitedCourse, Limits
from phcontrol.setpoints.live_motion import LiveMotion
from phcontrol.trajectories.minimum_jerk import usual_speed
from phcontrol.trajectories.trajectory import Reference


class LiveTrajectory(LiveMotion[Array]):
    """A trajectory of the joints to whatever posture was last asked for: the ``reference`` of a law.

    Each change goes on from where the course is, the fastest way within limits on speed, acceleration and jerk
    (:class:`JerkLimitedCourse`), all joints together: so position, velocity and acceleration never jump.

    Args:
        robot: the arm; goals beyond its joint limits are refused.
        origin: posture at first [rad]; by default the arm's home.
        fraction: of the velocity limits that the course may reach; a joint without one is given 1 rad/s (0.1 m/s).
        acceleration: over the speed [1/s]; by default 4.
        jerk: over the speed [1/s²]; by default ten times that.

    Raises:
        InvalidArgumentError: a posture of a wrong length, not finite or beyond limits; limits that are not positive.

    Example:
        >>> from phcontrol import load_robot
        >>> from phcontrol.setpoints import LiveTrajectory
        >>> goal = LiveTrajectory(load_robot("pera_shoulder"), [0.0, 0.0])
        >>> goal.request([0.5, 0.2])
        >>> goal.advance(0.0)
        >>> goal.at(10.0).position
        array([0.5, 0.2])
    """

    def __init__(
        self,
        robot: Robot,
        origin: ArrayLike | None = None,
        *,
        fraction: float = 0.5,
        acceleration: float | None = None,
        jerk: float | None = None,
    ) -> None:
        self.n, self.robot = robot.n, robot
        speed = number("fraction", fraction, minimum=0.0, exclusive=True) * usual_speed(robot)
        start = vector("origin", robot.home if origin is None else origin, robot.n)
        super().__init__(start)
        self._course = JerkLimitedCourse(start, Limits.of(per_joint("speed", speed, robot.n), acceleration, jerk))

    @property
    def duration(self) -> float:
        """When the course so far ends [s]; 0 before the first change."""
        return self._course.end

    def at(self, t: float) -> Reference:
        """Return position [rad], velocity [rad/s] and acceleration [rad/s²] at time t [s]."""
        return Reference(*self._course.at(self.plain(t))[1:])

    def checked(self, goal: Any) -> Array:
        """Return a goal as a posture. Raises InvalidArgumentError for none, and beyond joint limits."""
        posture, robot = vector("goal", goal, self.n), self.robot
        beyond = np.maximum(robot.lower - posture, posture - robot.upper)
        worst = int(np.argmax(beyond))
        if beyond[worst] > 0.0:
            message = f"puts joint '{robot.joint_names[worst]}' {beyond[worst]:.3g} beyond its limit"
            raise InvalidArgumentError("goal", message)
        return posture

    def _redirect(self, t: float, goal: Array) -> None:
        now = self._course.at(t)
        self._course.redirect(t, *now[1:], now.position + self.robot.difference(goal, now.position))
