"""What lines, arcs and figures share: a curve, and when the frame is where on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.derivatives import cross_matrices
from phcontrol.trajectories.frame_path import FrameReference, frame_name
from phcontrol.trajectories.minimum_jerk import MinimumJerk
from phcontrol.trajectories.pose import shortest_turn

Curve = Callable[[float], tuple[Array, Array, Array]]
"""(r, φ), where the frame is [m] and how far it is turned [rad], shape (4,), with its two derivatives by s."""
Timing = Callable[[float], tuple[float, float, float]]
"""s, ṡ, s̈ at a time [s]."""


class CurvedPath:
    """A frame along a curve r(s), turned by φ(s) about a fixed axis u of the world, both at s(t).

        ξ_d = (r′, φ′u)ṡ,   ξ̇_d = (r″, φ″u)ṡ² + (r′, φ′u)s̈,   R_d = exp(φ u×)R₀

    Curve and timing are functions of a module with their parameters bound, so that a path can be pickled.

    Args:
        frame: name of the link or frame that moves.
        curve: r and φ with their derivatives.
        timing: s(t) with its derivatives.
        duration: when the motion has ended, or its period [s].
        turned: R₀ and u; None leaves the orientation free.
    """

    def __init__(
        self, frame: str, curve: Curve, timing: Timing, duration: float, turned: tuple[Array, Array] | None
    ) -> None:
        self.frame = frame_name(frame)
        self.duration = duration
        self._curve, self._timing = curve, timing
        self._still, self._spread = None, np.eye(3, 4)
        if turned is not None:
            self._still, axis = turned
            turn = cross_matrices(axis[:, None])[0]
            self._across = turn @ self._still  # exp(φ u×) = 1 + sin φ u× + (1 − cos φ) u×u×
            self._back = turn @ self._across
            self._spread = np.eye(6, 4)
            self._spread[3:, 3] = axis

    def at(self, t: float) -> FrameReference:
        """Return pose, twist and acceleration at time t [s]."""
        s, rate, acceleration = self._timing(t)
        value, slope, bend = self._curve(s)
        turn = None
        if self._still is not None:
            angle = float(value[3])
            turn = self._still + math.sin(angle) * self._across + (1.0 - math.cos(angle)) * self._back
        twist = self._spread.dot(slope * rate)
        return FrameReference(value[:3], turn, twist, self._spread.dot(bend * rate**2 + slope * acceleration))


def rest_to_rest(travel_time: float, start: float) -> tuple[Timing, float]:
    """Return the minimum-jerk motion of s from 0 to 1, and when it has ended [s]."""
    motion = MinimumJerk([0.0], [1.0], travel_time, start=start)
    return partial(_progress, motion), motion.duration


def _progress(motion: MinimumJerk, t: float) -> tuple[float, float, float]:
    (s,), (rate,), (acceleration,) = motion.at(t)
    return float(s), float(rate), float(acceleration)


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
