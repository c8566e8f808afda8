"""The sinusoid of the thesis's tracking study."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.trajectories.trajectory import Reference


class Sinusoid:
    """Swing each joint: q_dᵢ(t) = Aᵢ sin(2πfᵢt + φᵢ) + Bᵢ (6.16), for ever.

    Each argument is one number for all joints or one each; the longest says how many joints there are.

    Args:
        amplitude: A [rad].
        frequency: f [Hz] (the thesis's ω is 2πf).
        phase: φ [rad]; −π/2 starts from rest at B − A.
        offset: B [rad].

    Example:
        >>> from phcontrol import Sinusoid
        >>> swing = Sinusoid([0.5, 0.2], [1.0, 0.5])  # [rad], [Hz]
        >>> swing.at(0.0).position, swing.at(0.5).position.round(6)
        (array([-0.5, -0.2]), array([0.5, 0. ]))
    """

    def __init__(
        self,
        amplitude: ArrayLike,
        frequency: ArrayLike,
        *,
        phase: ArrayLike = -0.5 * math.pi,
        offset: ArrayLike = 0.0,
    ) -> None:
        parts = {"amplitude": amplitude, "frequency": frequency, "phase": phase, "offset": offset}
        arrays = {name: finite_array(name, value) for name, value in parts.items()}
        sizes = {array.size for array in arrays.values() if array.ndim}
        if any(array.ndim > 1 for array in arrays.values()) or len(sizes) > 1:
            shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
            raise InvalidArgumentError("amplitude", f"and the others must be scalars or of one length: {shapes}")
        self.n = sizes.pop() if sizes else 1
        self.amplitude, self.frequency, self.phase, self.offset = (
            np.array(np.broadcast_to(array, self.n)) for array in arrays.values()
        )
        if (self.frequency < 0.0).any():
            raise InvalidArgumentError("frequency", "must be >= 0 [Hz]")
        # A sin(ωt + φ) = A cos φ sin ωt + A sin φ cos ωt: a table times (1, sin ωt, cos ωt) of each distinct ω
        self._rates = [float(rate) for rate in 2.0 * math.pi * np.unique(self.frequency)]
        self._table = self._make_table()

    @property
    def duration(self) -> float:
        """One period of the slowest joint that moves [s]; 0 if none does."""
        moving = (self.frequency > 0.0) & (self.amplitude != 0.0)
        return float(1.0 / self.frequency[moving].min()) if moving.any() else 0.0

    def at(self, t: float) -> Reference:
        """Return position, velocity and acceleration at time t [s]."""
        basis = [1.0]
        for rate in self._rates:
            basis += (math.sin(rate * t), math.cos(rate * t))
        n, values = self.n, self._table.dot(np.array(basis))
        return Reference(values[:n], values[n : 2 * n], values[2 * n :])

    def _make_table(self) -> Array:
        """Return what the basis is multiplied with: rows are positions, velocities and accelerations."""
        n = self.n
        table = np.zeros((3 * n, 1 + 2 * len(self._rates)))
        table[:n, 0] = self.offset
        along, across = self.amplitude * np.cos(self.phase), self.amplitude * np.sin(self.phase)
        for joint, rate in enumerate(2.0 * math.pi * self.frequency):
            column = 1 + 2 * self._rates.index(float(rate))
            a, b = along[joint], across[joint]
            table[joint::n, column] = a, -rate * b, -(rate**2) * a
            table[joint::n, column + 1] = b, rate * a, -(rate**2) * b
        return table
