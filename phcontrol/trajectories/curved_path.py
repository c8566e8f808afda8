"""What lines, arcs and figures share: a curve, and when the frame is where on it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from phcontrol._validation import Array, number, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics import kernels
from phcontrol.mechanics.derivatives import cross_matrices
from phcontrol.trajectories.frame_path import FrameReference, frame_name
from phcontrol.trajectories.minimum_jerk import minimum_jerk_step
from phcontrol.trajectories.pose import shortest_turn

_curve_point = kernels.curve_point


class Curve(NamedTuple):
    """Where the frame is and how far it is turned, (r, φ)(s) [m, rad]: a line, and waves about it.

    (r, φ) = (1, s, cos ks, cos 2ks, …, sin ks, sin 2ks, …) · table
    """

    table: Array
    """Shape (2 + 2m, 4): (r, φ) at s = 0 but for the waves, its slope, and what the m cosines and m sines add."""
    rate: float = 1.0
    """k, of the slowest wave."""


Timing = Callable[[float], tuple[float, float, float]]
"""s, ṡ, s̈ at a time [s]."""


class CurvedPath:
    """A frame along a curve r(s), turned by φ(s) about a fixed axis u of the world, both at s(t).

        ξ_d = (r′, φ′u)ṡ,   ξ̇_d = (r″, φ″u)ṡ² + (r′, φ′u)s̈,   R_d = exp(φ u×)R₀

    The timing is a function of a module with its parameters bound, so that a path can be pickled.

    Args:
        frame: name of the link or frame that moves.
        curve: r and φ.
        timing: s(t) with its derivatives.
        duration: when the motion has ended, or its period [s].
        turned: R₀ and u; None leaves the orientation free.
    """

    def __init__(
        self, frame: str, curve: Curve, timing: Timing, duration: float, turned: tuple[Array, Array] | None
    ) -> None:
        self.frame = frame_name(frame)
        self.duration = duration
        self._table, self._rate, self._timing = curve.table, float(curve.rate), timing
        self._turned: tuple[Array, Array, Array, Array] | None = None
        if turned is not None:
            still, axis = turned
            turn = cross_matrices(axis[:, None])[0]
            across = turn @ still  # exp(φ u×) = 1 + sin φ u× + (1 − cos φ) u×u×
            self._turned = still, across, turn @ across, axis

    def at(self, t: float) -> FrameReference:
        """Return pose, twist and acceleration at time t [s]."""
        return FrameReference(*_curve_point(self._table, self._rate, *self._timing(t), self._turned))


def rest_to_rest(travel_time: float, start: float) -> tuple[Timing, float]:
    """Return the minimum-jerk motion of s from 0 to 1, and when it has ended [s]."""
    time, begin = positive("travel_time", travel_time), number("start", start)
    return partial(_progress, time, begin), begin + time


def _progress(time: float, start: float, t: float) -> tuple[float, float, float]:
    s, slope, bend = minimum_jerk_step((t - start) / time)
    return s, slope / time, bend / (time * time)


def turn_of(origin: Array | None, goal: Array | None) -> tuple[tuple[Array, Array] | None, float]:
    """Return R₀ and u of the turn from an origin's to a goal's orientation, and its angle [rad].

    Raises InvalidArgumentError when one of both leaves its orientation free.
    """
    if origin is None and goal is None:
        return None, 0.0
    if origin is None or goal is None:
        raise InvalidArgumentError(
            "goal", "and origin must both be poses, or both be points: then the orientation is left free"
        )
    axis, angle = shortest_turn("goal", origin, goal)
    return (origin, axis), angle
