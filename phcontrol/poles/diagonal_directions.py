"""Diagonal gains: every joint a direction of its own."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from phcontrol._validation import Array
from phcontrol.poles.directions import Directions


class DiagonalDirections(Directions):
    """The joints, each with an inertia of M_ii/r, r the least eigenvalue of the pair (diag M, M).

    A gain f·M then is f·diag(M)/r: in the eigenvector of r it is f, and without friction the mode of that direction has
    the poles of the specification. In the others the gain is larger, by the ratios of the eigenvalues: they are faster.

    Args:
        inertia: M, shape (n, n).
        friction: D at rest, shape (n, n).
    """

    def __init__(self, inertia: Array, friction: Array) -> None:
        own = inertia.diagonal()
        self._own: Array = own / float(eigh(np.diag(own), inertia, eigvals_only=True)[0])
        self.friction = friction.diagonal() / self._own

    def matrix(self, kind: str, numbers: Array) -> Array:
        """Return the gain, diagonal, shape (n, n)."""
        return np.diag(numbers * self._own if kind == "force" else numbers)
