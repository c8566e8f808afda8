"""Diagonal gains that put the slowest mode of the joints where it should be."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from phcontrol._validation import Array
from phcontrol.design.poles import SHARE


class DiagonalDirections:
    """The diagonal of M in place of M, larger by 1/r with r the least eigenvalue of the pair (diag M, M).

    A gain f·M then is f·diag(M)/r: in the eigenvector of r it is f, and the mode of that direction has the poles of
    the specification. In the others it is larger, by the ratios of the eigenvalues: these are faster.

    Args:
        inertia: M, shape (n, n).
        friction: D at rest, shape (n, n).
    """

    def __init__(self, inertia: Array, friction: Array) -> None:
        own = inertia.diagonal()
        values = eigh(np.diag(own), inertia, eigvals_only=True)
        self._own: Array = own / float(values[0])
        self._friction = friction.diagonal()

    def matrix(self, kind: str, number: float) -> Array:
        """Return a gain, shape (n, n)."""
        return np.diag(number * self._own) if kind == "force" else number * np.eye(len(self._own))

    def damping(self, number: float, share: float) -> tuple[Array, bool]:
        """Return C less ``share`` of the friction, and whether friction left room for that."""
        desired = number * self._own
        left = desired - share * self._friction
        return np.diag(np.maximum(left, SHARE * desired)), bool((left >= SHARE * desired).all())
