"""What lines, arcs and figures share: a curve, and when the frame is where on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.derivatives import cross_matrices
from phcontrol.trajectories.frame_path import FrameReference
from phcontrol.trajectories.minimum_jerk import MinimumJerk
from phcontrol.trajectories.pose import rotation

Curve = Callable[[float], tuple[Array, Array, Array]]
"""(r, φ), where the frame is [m] and how far it is turned [rad], shape (4,), with its two derivatives by s."""
Timing = Callable[[float], tuple[float, float, float]]
"""s, ṡ, s̈ at a time [s]."""

NO_TURN = 1e-3
"""How near to half a turn the way round is not clear [rad]."""


class CurvedPath:
    """A frame along a curve r(s), turned by φ(s) about a fixed axis u of the world, both at s(t).

        ξ_d = (r′, φ′u)ṡ,   ξ̇_d = (r″, φ″u)ṡ² + (r′, φ′u)s̈,   R_d = exp(φ u×)R₀

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
            self._across = cross_matrices(axis[:, None])[0] @ self._still  # of the still, the sine and the versine part
            self._back = cross_matrices(axis[:, None])[0] @ self._across
            self._spread = np.eye(6, 4)
            self._spread[3:, 3] = axis

    def at(self, t: float) -> FrameReference:
        """Return pose, twist and acceleration at time t [s]."""
        s, rate, acceleration = self._timing(t)
        value, slope, bend = self._curve(s)
        turn = None
        if self._still is not None:
            angle = float(value[3])
            turn = self._still + np.sin(angle) * self._across + (1.0 - np.cos(angle)) * self._back
        twist = self._spread.dot(slope * rate)
        return FrameReference(value[:3], turn, twist, self._spread.dot(bend * rate**2 + slope * acceleration))


def frame_name(value: str) -> str:
    """Return the name of a frame; whether there is one of that name the robot says."""
    if not isinstance(value, str) or not value:
        raise InvalidArgumentError("frame", f"must be the name of a frame, but is {value!r}")
    return value


def rest_to_rest(travel_time: float, start: float) -> tuple[Timing, float]:
    """Return the minimum-jerk motion of s from 0 to 1, and when it has ended [s]."""
    motion = MinimumJerk([0.0], [1.0], travel_time, start=start)

    def timing(t: float) -> tuple[float, float, float]:
        (s,), (rate,), (acceleration,) = motion.at(t)
        return float(s), float(rate), float(acceleration)

    return timing, motion.duration


def turn_between(name: str, origin: Array, goal: Array) -> tuple[Array, float]:
    """Return the axis in the world and the angle of the shortest turn from one orientation to another [rad]."""
    between = rotation(name, goal @ origin.T)
    sine_axis = 0.5 * np.array(
        [between[2, 1] - between[1, 2], between[0, 2] - between[2, 0], between[1, 0] - between[0, 1]]
    )
    sine = float(np.linalg.norm(sine_axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(between) - 1.0)))
    if np.pi - angle < NO_TURN:
        raise InvalidArgumentError(
            name, "is half a turn from the orientation before it, and which way round is not clear: put one between"
        )
    return (sine_axis / sine if sine > 0.0 else np.array([0.0, 0.0, 1.0])), angle


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
    axis, angle = turn_between("goal", origin, goal)
    return (origin, axis), angle
