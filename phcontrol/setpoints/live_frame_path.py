"""A pose of a frame that may be changed while an arm runs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, positive
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.setpoints.jerk_limited_course import JerkLimitedCourse, Limits
from phcontrol.setpoints.live_motion import LiveMotion
from phcontrol.trajectories.frame_path import FrameReference, frame_name
from phcontrol.trajectories.pose import Pose, pose

_FARTHEST = 1000.0  # of a goal from the world's origin [m]
_SMALL = 1e-4  # θ², below which series are taken


class Place(NamedTuple):
    """Where a frame is."""

    position: Array
    rotation: Array | None


class LiveFramePath(LiveMotion[Place]):
    """The path of a frame to whatever pose was last asked for: the ``reference`` of a law about a frame's spring.

        R_d = exp(φ×)R_c,   R_c where it was at the last change

    Each change goes on from where the path is, the fastest way within limits on speed, acceleration and jerk
    (:class:`JerkLimitedCourse`) of r_d and φ together: so pose, twist and acceleration never jump. |ω_d| ≤ |φ̇|; ω̇_d
    has beside φ̈ what the turn of the axis adds, at most φ̇²/2.

    Args:
        frame: name of the link or frame that moves.
        origin: pose at first: a pin.SE3, a 4 × 4 matrix or a pair of a point [m] and a rotation matrix; a point alone
            leaves the orientation free, then goals are points.
        speed: of the frame's origin, that no direction exceeds [m/s].
        turning_speed: [rad/s].
        acceleration: over the speeds [1/s]; by default 4.
        jerk: over the speeds [1/s²]; by default ten times that.

    Raises:
        InvalidArgumentError: a pose that is none; limits that are not positive.

    Example:
        >>> import numpy as np
        >>> from phcontrol.setpoints import LiveFramePath
        >>> goal = LiveFramePath("tool", np.eye(4))
        >>> goal.request(([0.1, 0.0, 0.0], np.eye(3)))
        >>> goal.advance(0.0)
        >>> goal.at(5.0).position
        array([0.1, 0. , 0. ])
    """

    def __init__(
        self,
        frame: str,
        origin: Pose,
        *,
        speed: float = 0.25,
        turning_speed: float = 1.0,
        acceleration: float | None = None,
        jerk: float | None = None,
    ) -> None:
        self.frame = frame_name(frame)
        start = Place(*pose("origin", origin))
        speeds = [positive("speed", speed), positive("turning_speed", turning_speed)]
        super().__init__(start)
        self._turns = start.rotation is not None
        self._centres = [] if start.rotation is None else [start.rotation]
        """R_c of each leg, and at first."""
        first = np.concatenate([start.position, np.zeros(3)]) if self._turns else start.position
        each = np.repeat(speeds, 3)[: first.size] / math.sqrt(3.0)
        self._course = JerkLimitedCourse(first, Limits.of(each, acceleration, jerk))

    @property
    def duration(self) -> float:
        """When the course so far ends [s]; 0 before the first change."""
        return self._course.end

    def at(self, t: float) -> FrameReference:
        """Return pose, twist and acceleration at time t [s]."""
        leg, x, rate, bend = self._course.at(self.plain(t))
        if not self._turns:
            return FrameReference(x, None, rate, bend)
        spin, spin_rate = _turning(x[3:], rate[3:], bend[3:])
        rate[3:], bend[3:] = spin, spin_rate
        return FrameReference(x[:3], pin.exp3(x[3:]) @ self._centres[leg + 1], rate, bend)

    def checked(self, goal: Any) -> Place:
        """Return a goal as a place. Raises InvalidArgumentError for none, as the path asks for one."""
        place = Place(*pose("goal", goal))
        if (place.rotation is not None) != self._turns:
            wanted = "a pose, with an orientation" if self._turns else "a point: the orientation is left free"
            raise InvalidArgumentError("goal", f"must be {wanted}, as the path's origin is")
        if np.abs(place.position).max() > _FARTHEST:
            raise InvalidArgumentError("goal", f"must be in metres, within {_FARTHEST:g} m, but is {place.position}")
        return place

    def _redirect(self, t: float, goal: Place) -> None:
        now, target = self.at(t), goal.position
        if now.rotation is None or goal.rotation is None:
            self._course.redirect(t, now.position, now.twist, now.acceleration, target)
            return
        turn: Array = pin.log3(goal.rotation @ now.rotation.T)
        here = np.concatenate([now.position, np.zeros(3)])  # where φ = 0, ω = φ̇ and ω̇ = φ̈
        self._centres.append(now.rotation)  # first: at() on another thread goes by the course
        try:
            self._course.redirect(t, here, now.twist, now.acceleration, np.concatenate([target, turn]))
        except PHControlError:
            self._centres.pop()
            raise


def _turning(phi: Array, rate: Array, bend: Array) -> tuple[Array, Array]:
    """Return ω and ω̇ of exp(φ×), in the fixed axes.

    ω = (1 + aΦ + bΦ²)φ̇ with Φ = φ×, a = (1 − cos θ)/θ², b = (θ − sin θ)/θ³ and θ = |φ|; and its rate.
    """
    square = float(phi.dot(phi))
    if square < _SMALL:  # to the order that is left out, θ⁴: a and b, and what they change by over ½θ²
        a, b, a_slope, b_slope = 0.5 - square / 24.0, (1.0 - square / 20.0) / 6.0, -1.0 / 12.0, -1.0 / 60.0
    else:
        theta = math.sqrt(square)
        sine, cosine = math.sin(theta), math.cos(theta)
        a, b = (1.0 - cosine) / square, (theta - sine) / (square * theta)
        a_slope = (theta * sine - 2.0 * (1.0 - cosine)) / square**2
        b_slope = (theta * (1.0 - cosine) - 3.0 * (theta - sine)) / (square**2 * theta)
    across = np.cross(phi, rate)
    twice, radial = np.cross(phi, across), float(phi.dot(rate))
    spin = rate + a * across + b * twice
    bent = np.cross(phi, bend)
    spin_rate = (
        bend + a * bent + b * np.cross(phi, bent)
        + radial * (a_slope * across + b_slope * twice) + b * np.cross(rate, across)
    )  # fmt: skip
    return spin, spin_rate
