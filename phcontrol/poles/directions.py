"""The directions in which the joints move as one: gains of each become matrices."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from phcontrol._validation import Array


class Directions:
    """The eigenvectors of (D, M): VᵀM V = 1, VᵀD V = diag(d). Functions of D̄ = T⁻¹D T⁻ᵀ are diagonal in them.

    Args:
        inertia: M, shape (n, n).
        friction: D at rest, shape (n, n).
    """

    def __init__(self, inertia: Array, friction: Array) -> None:
        if friction.any():
            values, vectors = eigh(friction, inertia)
        else:
            factor = np.linalg.cholesky(inertia)
            values, vectors = np.zeros(len(inertia)), np.linalg.inv(factor).T
        self.friction: Array = np.maximum(values, 0.0)
        """d, shape (n,) [1/s]."""
        self._vectors, self._moved = vectors, inertia @ vectors
        self._turned = np.linalg.cholesky(inertia).T @ vectors

    def matrix(self, kind: str, numbers: Array) -> Array:
        """Return the gain of one number for each direction, shape (n, n); ``kind`` is of ``Poles.kinds``."""
        if kind == "rate":  # T⁻ᵀf(D̄)Tᵀ, which is not symmetric
            turned: Array = (self._vectors * numbers) @ self._moved.T
            return turned
        sides = self._moved if kind == "force" else self._turned
        matrix = (sides * numbers) @ sides.T
        result: Array = 0.5 * (matrix + matrix.T)
        return result
