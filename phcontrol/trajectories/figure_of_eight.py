"""A frame round and round a figure of eight, its axes turning to and fro."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import number, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.trajectories.curved_path import Curve, CurvedPath
from phcontrol.trajectories.minimum_jerk import minimum_jerk_step
from phcontrol.trajectories.pose import Pose, direction, pose


class FigureOfEight(CurvedPath):
    """Lead a frame along a figure of eight for ever, with its axes turned to and fro about a fixed axis.

        r_d = r₀ + ½w sin θ e₁ + ½h sin 2θ e₂,   R_d = exp(β sin θ u×)R₀,   θ = 2πt/period

    It sets out from rest in the centre: until ``ramp`` θ̇ grows to its value, by the minimum-jerk step, which costs half
    the ramp's time. Before 0 it stands. Without ramp it is periodic, in the past too.

    Args:
        frame: name of the link or frame that moves.
        center: pose (r₀, R₀), as for :class:`FrameLine`; a point leaves the orientation free.
        width: w, along e₁ [m].
        height: h, along e₂ [m].
        period: of one figure [s].
        turn: β [rad].
        along: direction of e₁ in the world.
        across: of e₂; only its part orthogonal to e₁ counts.
        axis: of u; by default of e₁ × e₂.
        ramp: how long it takes to reach its speed [s]; by default a quarter of the period.

    Example:
        >>> import numpy as np
        >>> from phcontrol import FigureOfEight, Pose
        >>> center = Pose(np.array([0.5, 0.0, 0.4]), np.eye(3))
        >>> path = FigureOfEight("hand", center, width=0.2, height=0.1, period=4.0)  # [m], [s]
        >>> path.at(0.0).position, path.at(20.0).position.round(6)
        (array([0.5, 0. , 0.4]), array([ 0.5     , -0.070711,  0.35    ]))
    """

    def __init__(
        self,
        frame: str,
        center: Pose,
        width: float,
        height: float,
        period: float,
        *,
        turn: float = 0.0,
        along: ArrayLike = (0.0, 1.0, 0.0),
        across: ArrayLike = (0.0, 0.0, 1.0),
        axis: ArrayLike | None = None,
        ramp: float | None = None,
    ) -> None:
        middle, still = pose("center", center)
        first = direction("along", along)
        second = direction("across", across)
        second = second - first * first.dot(second)
        if np.linalg.norm(second) < 1e-6:
            raise InvalidArgumentError("across", "must not be parallel to along")
        second = direction("across", second)
        angle = number("turn", turn)
        if still is None and (angle or axis is not None):
            raise InvalidArgumentError("turn", "needs a pose: a center that is a point leaves the orientation free")
        pivot = np.cross(first, second) if axis is None else direction("axis", axis)
        rate, start = 2.0 * math.pi / positive("period", period), 0.25 * period
        start = start if ramp is None else number("ramp", ramp, minimum=0.0)
        wide = np.append(0.5 * number("width", width) * first, angle)
        high = np.append(0.5 * number("height", height) * second, 0.0)
        still_there, no_wave = np.append(middle, 0.0), np.zeros(4)
        eight = Curve(np.stack([still_there, no_wave, no_wave, no_wave, wide, high]))
        turned = None if still is None else (still, pivot)
        super().__init__(frame, eight, partial(_ramped, rate, start), period + 0.5 * start, turned)


def _ramped(rate: float, ramp: float, t: float) -> tuple[float, float, float]:
    """Return θ, θ̇ and θ̈ of an angle that turns at ``rate`` [rad/s] after a smooth ramp [s] from rest."""
    if ramp == 0.0:
        return rate * t, rate, 0.0
    x = min(max(t / ramp, 0.0), 1.0)
    step, slope, _ = minimum_jerk_step(x)
    angle = rate * (ramp * x * x * x * x * (2.5 - 3.0 * x + x * x) + max(t - ramp, 0.0))
    return angle, rate * step, rate / ramp * slope
