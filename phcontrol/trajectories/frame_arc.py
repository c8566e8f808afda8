"""A frame along a circular arc."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, number, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.trajectories.curved_path import Curve, CurvedPath, rest_to_rest
from phcontrol.trajectories.pose import Pose, direction, pose, rotation, shortest_turn


class FrameArc(CurvedPath):
    """Move a frame along a circle, at rest at both ends, by a minimum-jerk timing s(t) from 0 to 1.

        r_d = c + cos(αs)a + sin(αs)n × a,   a the part of r₀ − centre that is orthogonal to n, c = r₀ − a

    Args:
        frame: name of the link or frame that moves.
        origin: pose where it begins, as for :class:`FrameLine`; a point leaves the orientation free.
        center: a point on the axis of the circle [m].
        axis: direction n of that axis, of any length.
        angle: α, how far round the axis, right-handed; more than a turn is a turn and more [rad].
        travel_time: how long the motion takes [s].
        orientation: "held", "turning" (along with the arc, by α about n), or the last rotation matrix, to which the
            frame turns the shortest way.
        start: when it begins [s].

    Example:
        >>> import numpy as np
        >>> from phcontrol import FrameArc, Pose
        >>> start = Pose(np.array([0.5, 0.1, 0.4]), np.eye(3))
        >>> arc = FrameArc("hand", start, [0.5, 0.0, 0.4], [0.0, 0.0, 1.0], angle=np.pi, travel_time=2.0)
        >>> arc.at(2.0).position.round(3)
        array([ 0.5, -0.1,  0.4])
    """

    def __init__(
        self,
        frame: str,
        origin: Pose,
        center: ArrayLike,
        axis: ArrayLike,
        angle: float,
        travel_time: float,
        *,
        orientation: Literal["held", "turning"] | ArrayLike = "held",
        start: float = 0.0,
    ) -> None:
        first, still = pose("origin", origin)
        normal, reach = direction("axis", axis), number("angle", angle)
        arm = first - vector("center", center, 3)
        arm = arm - normal * normal.dot(arm)
        if np.linalg.norm(arm) < 1e-9:
            raise InvalidArgumentError("center", "must be on an axis that does not go through the origin of the arc")
        turned, turn = _turn(still, orientation, normal, reach)
        along, across = np.append(arm, 0.0), np.append(np.cross(normal, arm), 0.0)
        arc = Curve(np.stack([np.append(first - arm, 0.0), [0.0, 0.0, 0.0, turn], along, across]), reach)
        super().__init__(frame, arc, *rest_to_rest(travel_time, start), turned)

    @classmethod
    def through(
        cls,
        frame: str,
        origin: Pose,
        via: ArrayLike,
        goal: Pose,
        travel_time: float,
        *,
        start: float = 0.0,
    ) -> FrameArc:
        """Return the arc from a pose by way of a point to another pose (or between points, the orientation left free).

        Raises InvalidArgumentError where the three lie on a line.
        """
        first, still = pose("origin", origin)
        last, final = pose("goal", goal)
        if (still is None) != (final is None):
            raise InvalidArgumentError("goal", "and origin must both be poses, or both be points")
        u, v = vector("via", via, 3) - first, last - first
        normal = np.cross(u, v)
        area = float(normal.dot(normal))
        if area <= 1e-12 * u.dot(u) * v.dot(v) or area == 0.0:
            raise InvalidArgumentError("via", "must not lie on a line with origin and goal (take a FrameLine)")
        center = first + np.cross(u.dot(u) * v - v.dot(v) * u, normal) / (2.0 * area)
        begin, end = first - center, last - center
        angle = math.atan2(normal.dot(np.cross(begin, end)) / math.sqrt(area), begin.dot(end)) % (2.0 * math.pi)
        orientation = "held" if final is None else final
        return cls(frame, origin, center, normal, angle, travel_time, orientation=orientation, start=start)


def _turn(
    still: Array | None, orientation: Literal["held", "turning"] | ArrayLike, normal: Array, angle: float
) -> tuple[tuple[Array, Array] | None, float]:
    """Return R₀ and the axis of the turn, and its angle [rad]."""
    if isinstance(orientation, str):
        turning = choice("orientation", orientation, ("held", "turning")) == "turning"
        if still is None and turning:
            raise InvalidArgumentError("orientation", "is left free by an origin that is a point: give a pose to turn")
        return (None if still is None else (still, normal)), angle if turning else 0.0
    if still is None:
        raise InvalidArgumentError("orientation", "is left free by an origin that is a point: give a pose to turn")
    axis, turn = shortest_turn("orientation", still, rotation("orientation", orientation))
    return (still, axis), turn
