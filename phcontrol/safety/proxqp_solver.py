"""Quadratic programs by ProxQP, a proximal augmented-Lagrangian method."""

from __future__ import annotations

import atexit
import math
import weakref
from typing import Any

import numpy as np
from proxsuite import proxqp

from phcontrol._validation import Array
from phcontrol.safety.problem import ACCEPTED, Problem

_MOST_ITERATIONS = 60
_MANY_ITERATIONS = 8  # of a warm start, after which the next is cold, with the solver's own step sizes
_MOST_INNER_ITERATIONS = 100  # normally fewer than ten: so that no period waits for a problem that has no solution
_LARGE_GRADIENT = 20.0  # from which the objective is scaled
_WARM = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
_COLD = proxqp.InitialGuess.NO_INITIAL_GUESS

_solvers: weakref.WeakSet[ProxqpSolver] = weakref.WeakSet()


@atexit.register
def _end_solvers() -> None:
    """Let go of all solvers: nanobind complains, in pages, of those that a thread or a cycle keeps until the end."""
    for solver in list(_solvers):
        solver.end()


class ProxqpSolver:
    """Solves one :class:`Problem` of n unknowns and m rows after another, each started from the last answer.

    What it answers is not believed but checked, by :class:`QuadraticProgram`. Four traps are avoided: with its own
    threshold for infeasibility (1e-4) it gives up problems that have solutions; a large gradient beside bounds of order
    one spoils it, so that the objective is scaled here; what a problem without a solution leaves spoils the next start,
    so that a new solver is made (``reset``); and on contradictory bounds it would iterate for half a second.
    """

    found_none = False
    """Whether it found that no point meets the constraints: it is not asked to."""

    def __init__(self, n: int, m: int) -> None:
        _solvers.add(self)
        self._n, self._m = n, m
        self._identity = np.eye(n)
        self.reset()

    def reset(self) -> None:
        """Make a new solver: after a failure an old one mostly fails again."""
        n, m = self._n, self._m
        solver = proxqp.dense.QP(n, 0, m, True, proxqp.dense.HessianType.Dense)
        settings = solver.settings
        settings.eps_abs, settings.eps_rel, settings.max_iter = ACCEPTED, 0.0, _MOST_ITERATIONS
        settings.max_iter_in = _MOST_INNER_ITERATIONS
        settings.eps_primal_inf = settings.eps_dual_inf = 0.0
        settings.check_duality_gap, settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = True, ACCEPTED, 0.0
        settings.compute_timings = settings.verbose = False
        one, bound, rows = np.ones(n), np.ones(m), np.eye(m, n)
        solver.init(np.eye(n), np.zeros(n), None, None, rows, -bound, bound, -one, one, compute_preconditioner=False)
        solver.solve()  # an update before the first solve would crash a warm start
        self._solver: Any = solver
        self._warm = self._starts_warm = self._scaled_last = False
        settings.initial_guess = _COLD

    def end(self) -> None:
        """Let go of the solver; nothing is solved any more."""
        self._solver = None

    def solve(self, problem: Problem) -> tuple[Array, Array]:
        """Return x and the multipliers of rows and box, finite or not, right or wrong."""
        solver = self._solver
        if self._starts_warm != self._warm:
            self._starts_warm = self._warm
            solver.settings.initial_guess = _WARM if self._starts_warm else _COLD
        size = math.sqrt(problem.gradient.dot(problem.gradient))
        size = 1.0 if size <= _LARGE_GRADIENT else size
        H, gradient = problem.hessian, problem.gradient
        if size != 1.0:
            H, gradient = (self._identity if H is None else H) / size, gradient / size
        elif H is None and self._scaled_last:
            H = self._identity
        self._scaled_last = H is not None and H is not self._identity
        solver.update(H, gradient, None, None, *problem[2:])
        solver.solve()
        results = solver.results
        x, multipliers = np.array(results.x), size * results.z
        self._warm = problem.accepted(x, multipliers) is not None and not (
            self._starts_warm and results.info.iter > _MANY_ITERATIONS
        )
        return x, multipliers
