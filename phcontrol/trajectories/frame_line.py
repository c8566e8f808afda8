"""A frame along a straight line."""

from __future__ import annotations

import numpy as np

from phcontrol.trajectories.curved_path import Curve, CurvedPath, rest_to_rest, turn_of
from phcontrol.trajectories.pose import Pose, pose


class FrameLine(CurvedPath):
    """Move a frame straight from one pose to another, at rest at both ends.

        r_d = r₀ + s(r₁ − r₀),   R_d = exp(sφ u×)R₀,   s = 10τ³ − 15τ⁴ + 6τ⁵ of the time τ = (t − start)/travel_time

    φ u is the shortest turn from R₀ to R₁, which is walked along with the same timing (slerp). Before and after it
    stands. The arm's present pose is ``x.placement(frame)`` of its state x.

    Args:
        frame: name of the link or frame that moves.
        origin: pose (r₀, R₀): a pin.SE3, a 4 × 4 matrix or a pair of a point [m] and a rotation matrix; a point alone
            leaves the orientation free.
        goal: pose (r₁, R₁), or a point where the origin is one; not half a turn away.
        travel_time: how long the motion takes [s].
        start: when it begins [s].

    Example:
        >>> import numpy as np
        >>> from phcontrol import FrameLine, Pose
        >>> start, end = Pose(np.array([0.5, 0.1, 0.4]), np.eye(3)), Pose(np.array([0.5, -0.1, 0.4]), np.eye(3))
        >>> line = FrameLine("hand", start, end, travel_time=2.0)
        >>> line.at(1.0).position.round(3), line.at(1.0).twist[:3].round(3)  # half way, fastest
        (array([0.5, 0. , 0.4]), array([ 0.   , -0.188,  0.   ]))
    """

    def __init__(self, frame: str, origin: Pose, goal: Pose, travel_time: float, *, start: float = 0.0) -> None:
        first, still = pose("origin", origin)
        last, final = pose("goal", goal)
        turned, angle = turn_of(still, final)
        line = Curve(np.stack([np.append(first, 0.0), np.append(last - first, angle)]))
        super().__init__(frame, line, *rest_to_rest(travel_time, start), turned)
