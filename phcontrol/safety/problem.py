"""One quadratic program, and the check of its answers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.safety import kernels

ACCEPTED = 1e-10
"""The largest residual of an answer that is believed, in scaled units, but for the rounding of large numbers."""

UNBOUNDED = 1e20
"""What counts as no bound."""

_ROUNDING = 1e-14  # of sums of gradient and forces, relative to them


def _length(values: Array) -> float:
    """Return the Euclidean norm; NaN when there is one inside."""
    return math.sqrt(values.dot(values))


class Problem(NamedTuple):
    """min ½zᵀH z + gᵀz subject to l ≤ C z ≤ u and a ≤ z ≤ b; rows of length one, everything of order one."""

    hessian: Array | None
    """H, shape (n, n); None for the identity."""
    gradient: Array
    """g, shape (n,)."""
    rows: Array
    """C, shape (m, n)."""
    lower: Array
    """l, shape (m,)."""
    upper: Array
    """u, shape (m,)."""
    lowest: Array
    """a, shape (n,)."""
    highest: Array
    """b, shape (n,)."""

    def residuals(self, z: Array, multipliers: Array) -> tuple[float, float]:
        """Return by how much z and the rows' multipliers λ miss the two conditions of optimality.

        They are z = clip(z − (H z + g + Cᵀλ), a, b) and C z = clip(C z + λ, l, u): true at the optimum and only there.
        """
        return kernels.residuals(*self, z, multipliers)

    def accepted(self, x: Array, multipliers: Array) -> Array | None:
        """Return x clipped to the box if that, with these multipliers (rows, then box), is the optimum, else None."""
        z: Array = np.minimum(np.maximum(x, self.lowest), self.highest)
        return z if self.accepts(z, multipliers[: self.lower.size]) else None

    def accepts(self, z: Array, multipliers: Array) -> bool:
        """Whether z, with these multipliers of the rows, is the optimum; never true of NaN."""
        return self.are_small(*self.residuals(z, multipliers), multipliers)

    def are_small(self, stationary: float, complementary: float, multipliers: Array) -> bool:
        """Whether residuals are those of an optimum; never true of NaN."""
        if not complementary <= ACCEPTED:
            return False
        if stationary <= ACCEPTED:
            return True
        return stationary <= _ROUNDING * (_length(self.gradient) + _length(multipliers))
