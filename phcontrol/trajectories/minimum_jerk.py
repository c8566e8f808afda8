"""From rest to rest as smoothly as can be."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from phcontrol._validation import Array, finite_array, number, positive, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.trajectories.piecewise import PiecewisePolynomial

PEAK_SPEED = 1.875
"""Largest speed of a minimum-jerk motion over its mean speed."""


def minimum_jerk_step(share: float) -> tuple[float, float, float]:
    """Return x³(10 − 15x + 6x²) of a share x of the way, held at 0 and 1, with its two derivatives by x."""
    x = min(max(share, 0.0), 1.0)
    rest = x * (1.0 - x)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * rest * rest, 60.0 * rest * (1.0 - 2.0 * x)


class MinimumJerk(PiecewisePolynomial):
    """Move from one posture to another, at rest at both, with the least ∫|jerk|² dt.

        q_d = a + (b − a)(10τ³ − 15τ⁴ + 6τ⁵),   τ = (t − start)/travel_time

    T. Flash and N. Hogan, "The coordination of arm movements", J. Neurosci. 5, 1985.

    Args:
        origin: posture a [rad].
        goal: posture b [rad].
        travel_time: how long the motion takes [s].
        start: when it begins [s].

    Example:
        >>> from phcontrol import MinimumJerk, load_robot
        >>> way = MinimumJerk([0.0, 0.0], [1.0, 0.5], travel_time=2.0)
        >>> way.at(1.0).position, way.at(1.0).velocity  # half way, and fastest: 15/8 of the mean speed
        (array([0.5 , 0.25]), array([0.9375 , 0.46875]))
        >>> MinimumJerk.within_limits(load_robot("pera_shoulder"), [0.0, 0.0], [1.0, 0.5]).duration > 0.5
        True
    """

    def __init__(self, origin: ArrayLike, goal: ArrayLike, travel_time: float, *, start: float = 0.0) -> None:
        a = finite_array("origin", origin)
        if a.ndim != 1 or a.size == 0:
            raise InvalidArgumentError("origin", f"must be a vector of joint positions, but has shape {a.shape}")
        way = vector("goal", goal, a.size) - a
        time, begin = positive("travel_time", travel_time), number("start", start)
        zero = np.zeros_like(a)
        coefficients = np.array([6.0 * way / time**5, -15.0 * way / time**4, 10.0 * way / time**3, zero, zero, a])
        super().__init__(PPoly(coefficients[:, None, :], [begin, begin + time]))

    @classmethod
    def within_limits(
        cls, robot: Robot, origin: ArrayLike, goal: ArrayLike, *, fraction: float = 0.5, start: float = 0.0
    ) -> MinimumJerk:
        """Return the motion whose speed reaches no more than a ``fraction`` of the joints' velocity limits.

        Continuous joints take the shorter way round. A joint without a velocity limit is given 1 rad/s
        (0.1 m/s if it is prismatic). The motion takes at least 1 s.
        """
        a = robot.position(origin)
        way = robot.difference(robot.position(goal), a)
        speed = number("fraction", fraction, minimum=0.0, exclusive=True) * usual_speed(robot)
        travel_time = max(1.0, float((PEAK_SPEED * np.abs(way) / speed).max()))
        return cls(a, a + way, travel_time, start=start)


def usual_speed(robot: Robot) -> Array:
    """Return the joints' velocity limits; where there is none 1 rad/s, or 0.1 m/s for a prismatic joint."""
    speed: Array = np.where(
        np.isfinite(robot.velocity_limit),
        robot.velocity_limit,
        np.where(np.array(robot.prismatic or [False] * robot.n), 0.1, 1.0),
    )
    return speed
