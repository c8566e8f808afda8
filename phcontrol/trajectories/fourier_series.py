"""A motion that is a finite Fourier series."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import finite_array, positive, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.trajectories.trajectory import Reference


class FourierSeries:
    """Swing each joint with several frequencies at once: what tells the parameters of an arm apart.

    With ω = 2π/period, for ever and once a period the same,

        q̇_d(t) = Σ_l a_l cos(lωt) + b_l sin(lωt),   q_d(0) = start.

    It starts from rest and without acceleration where Σ a_l = 0 and Σ l b_l = 0. (J. Swevers et al., IEEE T-RA 13(5),
    1997.)

    Args:
        start: q_d(0), shape (n,) [rad].
        cosine: a, shape (n, harmonics) [rad/s].
        sine: b, likewise.
        period: [s].

    Example:
        >>> from phcontrol import FourierSeries
        >>> FourierSeries([0.1], [[0.5, -0.5]], [[0.0, 0.0]], 10.0).at(10.0).position
        array([0.1])
    """

    def __init__(self, start: ArrayLike, cosine: ArrayLike, sine: ArrayLike, period: float) -> None:
        self.cosine, self.sine = finite_array("cosine", cosine), finite_array("sine", sine)
        if self.cosine.ndim != 2 or not self.cosine.size or self.cosine.shape != self.sine.shape:
            raise InvalidArgumentError(
                "sine", f"must have the shape (n, harmonics) of cosine, {self.cosine.shape}, but has {self.sine.shape}"
            )
        self.n = len(self.cosine)
        self.start = vector("start", start, self.n)
        self.period = positive("period", period)
        self._rates = 2.0 * math.pi / self.period * np.arange(1, self.cosine.shape[1] + 1)
        self._middle = self.start + (self.sine / self._rates).sum(axis=1)

    @property
    def duration(self) -> float:
        """One period [s]."""
        return self.period

    def at(self, t: float) -> Reference:
        """Return position, velocity and acceleration at time t [s]."""
        cos, sin = np.cos(self._rates * t), np.sin(self._rates * t)
        return Reference(
            self._middle + self.cosine @ (sin / self._rates) - self.sine @ (cos / self._rates),
            self.cosine @ cos + self.sine @ sin,
            self.sine @ (self._rates * cos) - self.cosine @ (self._rates * sin),
        )
