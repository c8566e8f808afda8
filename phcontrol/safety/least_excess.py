"""Where bounds cannot be kept: the point that leaves them least."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.safety import kernels
from phcontrol.safety.problem import UNBOUNDED, Problem
from phcontrol.safety.quadratic_program import QuadraticProgram, SolverName

_INSISTENCE = 1e4  # weight of the excess against the distance from the preferred point


class LeastExcess:
    """min ½|z − z₀|² + ½·10⁴|s|² subject to l ≤ C z + s ≤ u, |z| ≤ b: s is by how much the rows C leave their bounds.

    Bounds that no z of the box can reach count as if they were 1 beyond its reach. When all bounds can be kept,
    s is of the order 10⁻⁴ at most.

    Args:
        n: number of unknowns z and of rows of length one.
        solver: that is asked first.
    """

    def __init__(self, n: int, solver: SolverName = "daqp") -> None:
        self._n = n
        self._program = QuadraticProgram(2 * n, n, solver)
        self._hessian = np.diag(np.concatenate([np.ones(n), np.full(n, _INSISTENCE)]))
        self._gradient, self._box = np.zeros(2 * n), np.full(2 * n, UNBOUNDED)
        self._rows = np.hstack([np.zeros((n, n)), np.eye(n)])

    def reset(self) -> None:
        """Forget the last answer."""
        self._program.reset()

    def solve(self, rows: Array, lower: Array, upper: Array, highest: Array, preferred: Array) -> Array | None:
        """Return z, or None when no answer passes the check."""
        n = self._n
        self._rows[:, :n] = rows
        np.negative(preferred, out=self._gradient[:n])
        self._box[:n] = highest
        lower, upper, feasible = kernels.elastic_bounds(rows, lower, upper, highest, preferred)
        problem = Problem(self._hessian, self._gradient, self._rows, lower, upper, -self._box, self._box)
        answer = self._program.solve(problem, feasible)
        return None if answer is None else answer[:n]
