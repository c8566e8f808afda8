"""A frame through poses, smoothly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.trajectories.interpolated_path import InterpolatedPath, quaternions
from phcontrol.trajectories.pose import Pose, pose
from phcontrol.trajectories.splines import QuinticSpline


class FrameSpline(InterpolatedPath):
    """Lead a frame through poses by quintic polynomials of its position and its quaternion.

    Continuous up to the fourth derivative; at rest at both ends, with no acceleration there, unless it is periodic.

    Args:
        frame: name of the link or frame that moves.
        waypoints: poses as for :class:`FrameLine`, at least two; or points, which leave the orientation free. Two
            that follow each other must not be half a turn apart.
        times: when to pass them, increasing, shape (m,) [s]; or how long it takes from the first at 0 to the last,
            shared out by the lengths of the straight ways between them.
        periodic: repeat for ever; the last waypoint must be the first, and there must be at least six.
        length: how many metres of way a turn of 1 rad counts as, where ``times`` is shared out [m/rad].

    Example:
        >>> import numpy as np
        >>> from phcontrol import FrameSpline, Pose
        >>> poses = [Pose(np.array([0.5, y, 0.4]), np.eye(3)) for y in (0.0, 0.1, 0.0)]
        >>> path = FrameSpline("hand", poses, [0.0, 1.0, 2.0])
        >>> path.at(1.0).position.round(6)
        array([0.5, 0.1, 0.4])
    """

    def __init__(
        self,
        frame: str,
        waypoints: Sequence[Pose],
        times: ArrayLike,
        *,
        periodic: bool = False,
        length: float = 0.3,
    ) -> None:
        poses = [pose(f"waypoints[{k}]", waypoint) for k, waypoint in enumerate(waypoints)]
        if len(poses) < (6 if periodic else 2):
            raise InvalidArgumentError(
                "waypoints", f"must be at least {6 if periodic else 2} poses, but are {len(poses)}"
            )
        points, turns = np.array([point for point, _ in poses]), [turn for _, turn in poses]
        oriented = [turn for turn in turns if turn is not None]
        if oriented and len(oriented) < len(turns):
            raise InvalidArgumentError("waypoints", "must all be poses, or all points: then the orientation is free")
        columns = np.hstack([points, quaternions("waypoints", oriented)]) if oriented else points
        instants = _instants(times, columns, positive("length", length))
        if not periodic:
            super().__init__(frame, QuinticSpline(instants, columns))
            return
        period = float(instants[-1] - instants[0])
        if oriented:
            _check_closed(points, oriented)
            if columns[0, 3:].dot(columns[-1, 3:]) < 0.0:  # a whole turn: the quaternion comes round the second time
                back = columns[1:] * np.repeat([1.0, -1.0], [3, 4])
                columns, instants = np.vstack([columns, back]), np.append(instants, instants[1:] + period)
        super().__init__(frame, QuinticSpline(instants, columns, periodic=True), period)


def _instants(times: ArrayLike, columns: Array, length: float) -> Array:
    """Return when each waypoint is passed [s]."""
    instants = finite_array("times", times)
    if instants.ndim:
        return instants
    ways = np.linalg.norm(np.diff(columns[:, :3], axis=0), axis=1)
    if columns.shape[1] > 3:  # the angle between unit quaternions is half that of the turn
        cosines = np.clip(np.sum(columns[:-1, 3:] * columns[1:, 3:], axis=1), -1.0, 1.0)
        ways = ways + length * 2.0 * np.arccos(cosines)
    if not (ways > 0.0).all():
        number = int(np.argmin(ways))
        raise InvalidArgumentError("waypoints", f"{number} and {number + 1} are the same: say when to pass each")
    shares: Array = positive("times", float(instants)) * np.append(0.0, np.cumsum(ways)) / ways.sum()
    return shares


def _check_closed(points: Array, turns: list[Array]) -> None:
    gap = max(float(np.abs(points[-1] - points[0]).max()), float(np.abs(turns[-1] - turns[0]).max()))
    if gap > 1e-9:
        raise InvalidArgumentError("waypoints", f"of a periodic path must end where they start, but are {gap:g} apart")
