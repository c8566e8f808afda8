"""A convex quadratic constraint."""

from __future__ import annotations

import math
from typing import NamedTuple

from phcontrol._validation import Array


class QuadraticConstraint(NamedTuple):
    """e + gᵀ(z − c) + ½(z − c)ᵀK(z − c) ≤ 0, everything of order one, K positive semidefinite."""

    centre: Array
    """c, shape (n,)."""
    excess: float
    """e: the value at c."""
    slope: Array
    """g, shape (n,)."""
    curvature: Array
    """K, shape (n, n)."""

    def value(self, z: Array) -> float:
        """Return the left side: ≤ 0 where the constraint is met."""
        way = z - self.centre
        return self.excess + float(way.dot(self.slope + 0.5 * self.curvature.dot(way)))

    def tangent(self, z: Array) -> tuple[Array, float, float]:
        """Return row, bound and length of the tangent at z: row·y ≤ bound for all y that meet the constraint.

        The row has length one; a multiplier of it is ``length`` times that of the constraint itself.
        """
        way = z - self.centre
        bend = self.curvature.dot(way)
        row = self.slope + bend
        length = math.sqrt(row.dot(row))
        bound = row.dot(z) - self.excess - float(way.dot(self.slope + 0.5 * bend))
        if length > 0.0:
            row /= length
            bound /= length
        return row, bound, length
