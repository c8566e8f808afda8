"""Trajectories made of polynomials."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from phcontrol._validation import Array, finite_array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.trajectories.trajectory import Reference


class PiecewisePolynomial:
    """A motion given by polynomials between instants, evaluated with its derivatives in one product.

    Before its first instant the arm stands at the first position, after its last at the last one, with
    no velocity and no acceleration; a ``periodic`` one repeats instead.

    Args:
        polynomials: a SciPy piecewise polynomial with values of shape (n,); its breakpoints are times [s].
        periodic: whether it repeats.
    """

    def __init__(self, polynomials: PPoly, *, periodic: bool = False) -> None:
        self.start, self.end = float(polynomials.x[0]), float(polynomials.x[-1])
        self.n: int = polynomials.c.shape[2]
        self.periodic = periodic
        order = polynomials.c.shape[0]
        parts = [np.zeros((order, polynomials.c.shape[1], self.n)) for _ in range(3)]
        for part, derivative in zip(parts, range(3), strict=True):
            coefficients = polynomials.derivative(derivative).c
            part[order - coefficients.shape[0] :] = coefficients
        # one table a piece: rows are powers, columns are positions, velocities and accelerations
        self._tables: list[Array] = [
            np.ascontiguousarray(np.hstack([part[::-1, piece] for part in parts]))
            for piece in range(polynomials.c.shape[1])
        ]
        self._breaks = [float(value) for value in polynomials.x]
        self._higher_powers = range(1, order)
        self._first, self._last = self._rest(self.start), self._rest(self.end)

    @property
    def duration(self) -> float:
        """When the motion has ended, or one period of it [s]."""
        return self.end - self.start if self.periodic else max(0.0, self.end)

    @property
    def pieces(self) -> int:
        """How many polynomials there are."""
        return len(self._tables)

    def at(self, t: float) -> Reference:
        """Return position, velocity and acceleration at time t [s]."""
        if self.periodic:
            t = self.start + math.fmod(t - self.start, self.end - self.start)
            if t < self.start:
                t += self.end - self.start
        elif t <= self.start:
            return self._first
        elif t >= self.end:
            return self._last
        return self._evaluate(t)

    def _evaluate(self, t: float) -> Reference:
        piece = min(bisect_right(self._breaks, t) - 1, len(self._tables) - 1)
        elapsed, n = t - self._breaks[piece], self.n
        powers, power = [1.0], 1.0
        for _ in self._higher_powers:
            power *= elapsed
            powers.append(power)
        values: Array = np.array(powers).dot(self._tables[piece])
        return Reference(values[:n], values[n : 2 * n], values[2 * n :])

    def _rest(self, t: float) -> Reference:
        position, zero = self._evaluate(t).position.copy(), np.zeros(self.n)
        for array in (position, zero):
            array.flags.writeable = False
        return Reference(position, zero, zero)


def check_knots(times: ArrayLike, positions: ArrayLike, least: int) -> tuple[Array, Array]:
    """Return increasing times, shape (m,) [s], and positions, shape (m, n) [rad], at least ``least`` of them."""
    instants, points = finite_array("times", times), finite_array("positions", positions)
    if points.ndim != 2 or points.shape[1] == 0:
        raise InvalidArgumentError(
            "positions", f"must have shape (points, joints), one row a point, but has shape {points.shape}"
        )
    if instants.shape != (len(points),):
        raise InvalidArgumentError("times", f"must have shape ({len(points)},), but has shape {instants.shape}")
    if len(points) < least:
        raise InvalidArgumentError("positions", f"must hold at least {least} points, but holds {len(points)}")
    if (np.diff(instants) <= 0.0).any():
        raise InvalidArgumentError("times", "must increase")
    return instants, points


def check_period(positions: Array) -> None:
    """Raise InvalidArgumentError unless a periodic motion ends where it starts."""
    gap = float(np.abs(positions[-1] - positions[0]).max())
    if gap > 1e-9:
        raise InvalidArgumentError(
            "positions", f"of a periodic motion must end where they start, but are {gap:g} apart"
        )
