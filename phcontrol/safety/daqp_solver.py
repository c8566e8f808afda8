"""Quadratic programs by DAQP, a dual active-set method."""

from __future__ import annotations

import math

import daqp
import numpy as np

from phcontrol._validation import Array
from phcontrol.safety.problem import UNBOUNDED, Problem

_INFINITE = 1e30  # what DAQP takes for no bound
_ACCURACY = 1e-11  # to which it meets the constraints, in scaled units
_MOST_ITERATIONS = 300  # normally fewer than twenty


class DaqpSolver:
    """Solves one :class:`Problem` of n unknowns and m rows after another, each on its own: nothing is remembered.

    What it answers is not believed but checked, by :class:`QuadraticProgram`. What it says of a problem without a
    solution is no proof either: the multipliers that it returns with that are memory that was never written.
    """

    def __init__(self, n: int, m: int) -> None:
        self._n = n
        self._identity = np.eye(n)
        self._upper, self._lower = np.empty(n + m), np.empty(n + m)
        self._kinds = np.zeros(n + m, dtype=np.int32)  # each an inequality, none assumed to be active
        self._found_none = False

    @property
    def found_none(self) -> bool:
        """Whether the last answer was that no point meets the constraints."""
        return self._found_none

    def reset(self) -> None:
        """Forget the last answer."""
        self._found_none = False

    def solve(self, problem: Problem) -> tuple[Array, Array] | None:
        """Return x and the multipliers of rows and box, or None; finite or not, right or wrong."""
        n, lower, upper = self._n, self._lower, self._upper
        H, gradient = problem.hessian, problem.gradient
        size = math.sqrt(gradient.dot(gradient))
        if H is None:
            H = self._identity
        if size > 1.0:  # it wants numbers of order one
            H, gradient = H / size, gradient / size
        else:
            size = 1.0
        lower[:n], lower[n:], upper[:n], upper[n:] = problem.lowest, problem.lower, problem.highest, problem.upper
        lower[lower <= -UNBOUNDED], upper[upper >= UNBOUNDED] = -_INFINITE, _INFINITE
        self._kinds[:] = 0
        x, _, flag, found = daqp.solve(
            np.ascontiguousarray(H), gradient, problem.rows, upper, lower, self._kinds,
            primal_tol=_ACCURACY, iter_limit=_MOST_ITERATIONS,
        )  # fmt: skip
        self._found_none = flag == -1
        if flag != 1:
            return None
        forces = found["lam"]
        return x, size * np.concatenate((forces[n:], forces[:n]))
