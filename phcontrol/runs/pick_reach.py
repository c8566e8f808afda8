"""How the hand gets to what it sees without losing sight of it."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.trajectories.minimum_jerk import MinimumJerk
from phcontrol.trajectories.splines import QuinticSpline
from phcontrol.trajectories.trajectory import Trajectory
from phcontrol.vision.goal_posture import goal_posture
from phcontrol.vision.observed_object import ObservedObject

_WAYPOINTS = 9
_SHARES = np.linspace(0.0, 1.0, 400)  # of the duration, where velocities are looked at


def way_in_image(
    system: MechanicalSystem, seen: ObservedObject, start: Array, goal: Array, *, fraction: float = 0.7
) -> Trajectory:
    """Return a motion of the joints along which what is seen goes straight to where it should be in the image.

    It begins and ends at rest, with velocities up to a fraction of the limits. Where no postures are found along the
    way, the arm stays where it is.

    Args:
        system: the arm.
        seen: what is seen, where it is thought to be.
        start: posture to start from [rad].
        goal: features (μ, ν, l) at the end [m].
        fraction: of the velocity limits.
    """
    shares = np.linspace(0.0, 1.0, _WAYPOINTS)
    ways = shares**3 * (10.0 - 15.0 * shares + 6.0 * shares**2)  # of least jerk
    first = seen.features(system.at(start))
    postures = [start]
    try:
        for way in ways[1:]:
            postures.append(goal_posture(system, seen, first + way * (goal - first), guess=postures[-1]))
    except PHControlError:
        return MinimumJerk.within_limits(system.robot, start, start)
    motion = QuinticSpline(shares, postures)
    velocities = np.array([motion.at(float(share)).velocity for share in _SHARES])
    duration = float((np.abs(velocities).max(axis=0) / (fraction * system.robot.velocity_limit)).max())
    return QuinticSpline(shares * max(duration, 0.1), postures)
