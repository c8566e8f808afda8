"""Splines through waypoints, and through samples of a motion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import interpolate

from phcontrol._validation import Array, number
from phcontrol.trajectories.piecewise import PiecewisePolynomial, check_knots, check_period


class CubicSpline(PiecewisePolynomial):
    """Pass waypoints at given times by cubic polynomials: continuous accelerations inside, at rest at both ends.

    The acceleration jumps at the two ends (not in a ``periodic`` motion); :class:`QuinticSpline` has none.

    Args:
        times: increasing, shape (m,) [s].
        positions: shape (m, n) [rad].
        periodic: repeat for ever; the last waypoint must be the first.

    Example:
        >>> from phcontrol import CubicSpline
        >>> way = CubicSpline([0.0, 1.0, 2.0], [[0.0], [0.5], [0.0]])  # [s], [rad]
        >>> way.at(1.0).position, way.at(2.0).velocity
        (array([0.5]), array([0.]))
    """

    def __init__(self, times: ArrayLike, positions: ArrayLike, *, periodic: bool = False) -> None:
        instants, points = check_knots(times, positions, 3 if periodic else 2)
        if periodic:
            check_period(points)
            points = _closed(points)
        ends = "periodic" if periodic else "clamped"
        super().__init__(interpolate.CubicSpline(instants, points, bc_type=ends), periodic=periodic)


class QuinticSpline(PiecewisePolynomial):
    """Pass waypoints at given times by quintic polynomials: continuous up to the fourth derivative.

    It begins and ends with no velocity and no acceleration, unless it is ``periodic``.

    Args:
        times: increasing, shape (m,) [s].
        positions: shape (m, n) [rad].
        periodic: repeat for ever; the last waypoint must be the first, and there must be at least six.

    Example:
        >>> from phcontrol import QuinticSpline
        >>> way = QuinticSpline([0.0, 1.0, 2.0], [[0.0], [0.5], [0.0]])
        >>> way.at(1.0).position, way.at(2.0).acceleration.round(9)
        (array([0.5]), array([0.]))
    """

    def __init__(self, times: ArrayLike, positions: ArrayLike, *, periodic: bool = False) -> None:
        instants, points = check_knots(times, positions, 6 if periodic else 2)
        if periodic:
            check_period(points)
            spline = interpolate.make_interp_spline(instants, _closed(points), k=5, bc_type="periodic")
        else:
            zero = np.zeros(points.shape[1])
            rest = [(1, zero), (2, zero)]
            spline = interpolate.make_interp_spline(instants, points, k=5, bc_type=(rest, rest))
        super().__init__(_pieces(spline, instants), periodic=periodic)


class SampledTrajectory(PiecewisePolynomial):
    """A motion from samples of it, as a recording or a planner gives them.

    Without smoothing, the quintic spline through the samples (of a lower, odd degree when there are fewer than six);
    with it, the cubic spline that weighs closeness against bending, Σ|q_d(t_k) − q_k|² + λ∫|q̈_d|² dt.
    The ends are taken as they are: unless the motion begins and ends at rest, its velocity jumps there.

    Args:
        times: increasing, shape (m,) [s].
        positions: shape (m, n) [rad]; at least two, with smoothing at least five.
        smoothing: λ ≥ 0 [s³]; 0 passes every sample. About (noise period)³ takes away noise of that period.

    Example:
        >>> import numpy as np
        >>> from phcontrol import SampledTrajectory
        >>> t = np.linspace(0.0, 2.0, 41)
        >>> way = SampledTrajectory(t, np.sin(t)[:, None])
        >>> way.at(1.0).velocity.round(3)  # cos 1
        array([0.54])
    """

    def __init__(self, times: ArrayLike, positions: ArrayLike, *, smoothing: float = 0.0) -> None:
        weight = number("smoothing", smoothing, minimum=0.0)
        instants, points = check_knots(times, positions, 5 if weight else 2)
        if weight:
            # joint by joint: SciPy takes several at once only since 1.16, which Python 3.10 cannot have
            parts = [interpolate.make_smoothing_spline(instants, joint, lam=weight) for joint in points.T]
            spline = interpolate.BSpline(parts[0].t, np.stack([part.c for part in parts], axis=1), parts[0].k)
        else:
            degree = next(k for k in (5, 3, 1) if k < len(points))
            spline = interpolate.make_interp_spline(instants, points, k=degree)
        super().__init__(_pieces(spline, instants))


def _closed(points: Array) -> Array:
    """Return points whose last is exactly the first, as SciPy demands of a period."""
    closed: Array = points.copy()
    closed[-1] = closed[0]
    return closed


def _pieces(spline: interpolate.BSpline, instants: Array) -> interpolate.PPoly:
    """Return the polynomials of a B-spline between the first and the last instant, by Taylor's formula."""
    knots = np.unique(spline.t)
    breaks = knots[(knots >= instants[0]) & (knots <= instants[-1])]
    taylor = [spline(breaks[:-1], power) / math.factorial(power) for power in range(spline.k, -1, -1)]
    return interpolate.PPoly(np.array(taylor), breaks)
