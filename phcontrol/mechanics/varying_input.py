"""An input matrix that depends on where the arm is: G(q) of thesis (2.2)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError

_SINGULAR = 1e-12
"""Reciprocal condition number from which on a matrix counts as singular."""


class VaryingInput:
    """G(q) as a function gives it, checked wherever it is asked: n × n, finite, invertible.

    Args:
        function: q ↦ G(q), shape (n, n); it may not write to q.
        size: n.
    """

    def __init__(self, function: Callable[[Array], ArrayLike], size: int) -> None:
        self._function = function
        self._size = size

    def matrix(self, position: Array) -> Array:
        """Return G(q), shape (n, n). Raises InvalidArgumentError where it is of another shape, or singular."""
        return self._checked(position)[0]

    def solve(self, position: Array, force: Array) -> Array:
        """Return u = G(q)⁻¹f, shape (n,) [N·m]."""
        _, lu, pivots = self._checked(position)
        torque: Array = lapack.dgetrs(lu, pivots, force)[0]
        return torque

    def _checked(self, position: Array) -> tuple[Array, Array, Array]:
        """Return G(q) and its factors."""
        seen = position.view()
        seen.flags.writeable = False
        G = np.array(self._function(seen), dtype=float)
        if G.shape != (self._size, self._size) or not np.isfinite(G).all():
            message = f"must give {self._size} × {self._size} finite numbers, but at {position} it gives {G.tolist()}"
            raise InvalidArgumentError("input_matrix", message)
        lu, pivots, _ = lapack.dgetrf(G)
        if lapack.dgecon(lu, np.abs(G).sum(axis=0).max())[0] < _SINGULAR:
            raise InvalidArgumentError("input_matrix", f"must be invertible, but is not at {position}")
        return G, lu, pivots
