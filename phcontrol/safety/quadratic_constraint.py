"""A convex quadratic constraint."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array
from phcontrol.safety import kernels


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
        return kernels.parabola(z, *self)

    def tangent(self, z: Array) -> tuple[Array, float, float]:
        """Return row, bound and length of the tangent at z: row·y ≤ bound for all y that meet the constraint.

        The row has length one; a multiplier of it is ``length`` times that of the constraint itself.
        """
        return kernels.tangent(z, *self)
