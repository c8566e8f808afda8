"""The quadratic programs of the torque filter, on ProxQP, with answers that are checked."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from proxsuite import proxqp

from phcontrol._validation import Array
from phcontrol.safety import kernels
from phcontrol.safety._numpy import active_equations

ACCURACY = 1e-10
"""What is asked of the solver, in scaled units."""
ACCEPTED = 1e-10
"""The largest residual of an answer that is believed, in scaled units (relative to a large gradient)."""

_MOST_ITERATIONS = 60
_MANY_ITERATIONS = 8  # of a warm start, after which the next is cold, with the solver's own step sizes
_LARGE_GRADIENT = 20.0  # from which the objective is scaled
_MOST_CORRECTIONS = 6
_STEP_SIZES = (10.0, 0.01, 0.1)  # of the dual variables, tried one after the other where the last solver failed
_MOST_INNER_ITERATIONS = 100  # normally fewer than ten: so that no period waits for a problem that has no solution
_WARM = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
_COLD = proxqp.InitialGuess.NO_INITIAL_GUESS


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
        stationary, complementary = self.residuals(z, multipliers)
        if not complementary <= ACCEPTED:
            return False
        return stationary <= ACCEPTED or stationary <= 0.1 * ACCEPTED * _length(self.gradient)


class QuadraticProgram:
    """Solves one :class:`Problem` of n unknowns and m rows after another, each started from the last answer.

    Mostly the constraints that were active last are active again: then one set of equations gives the optimum, and
    ProxQP is not asked. An answer counts only if the residuals of the optimality conditions, computed here, are below
    ``ACCEPTED``. Where ProxQP's is not that exact, the equations of the constraints that it found active are solved
    directly, the active constraints are corrected by that solution, and so on (a primal-dual active-set method); the
    result is checked likewise. Three traps of ProxQP are avoided: with its own threshold for infeasibility (1e-4) it
    gives up problems that have solutions; a large gradient beside bounds of order one spoils it, so that the objective
    is scaled here; and multipliers left by a problem without a solution spoil the next warm start.
    """

    def __init__(self, n: int, m: int) -> None:
        self._n, self._m = n, m
        self._identity = np.eye(n)
        self.reset()

    def reset(self) -> None:
        """Forget the last answer."""
        self._start_afresh(_STEP_SIZES[-1])
        self._last: tuple[Array, Array] | None = None

    def _start_afresh(self, step_size: float) -> None:
        """Make a new solver: after a failure an old one mostly fails again."""
        n, m = self._n, self._m
        solver = proxqp.dense.QP(n, 0, m, True, proxqp.dense.HessianType.Dense)
        settings = solver.settings
        settings.eps_abs, settings.eps_rel, settings.max_iter = ACCURACY, 0.0, _MOST_ITERATIONS
        settings.max_iter_in, settings.default_mu_in = _MOST_INNER_ITERATIONS, step_size
        settings.eps_primal_inf = settings.eps_dual_inf = 0.0
        settings.check_duality_gap, settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = True, ACCURACY, 0.0
        settings.compute_timings = settings.verbose = False
        one, bound, rows = np.ones(n), np.ones(m), np.eye(m, n)
        solver.init(np.eye(n), np.zeros(n), None, None, rows, -bound, bound, -one, one, compute_preconditioner=False)
        solver.solve()  # an update before the first solve would crash a warm start
        self._solver: Any = solver
        self._warm = self._starts_warm = self._scaled_last = False
        settings.initial_guess = _COLD

    def solve(self, problem: Problem, *, patient: bool = True) -> Array | None:
        """Return the optimum, exactly inside the box, or None when no answer passes the check.

        Where the first attempt fails, patience tries new solvers.
        """
        last = self._last
        answer = None if last is None else self._with_the_same_constraints(problem, *last)
        if answer is None:
            answer = self._attempt(problem)
        if answer is None and patient:
            if last is not None:
                answer = self._corrected(problem, *last)
            for step_size in _STEP_SIZES:
                if answer is None:
                    self._start_afresh(step_size)
                    answer = self._attempt(problem)
        return answer

    def _attempt(self, problem: Problem) -> Array | None:
        """Return ProxQP's answer, made exact, or None."""
        solver = self._solver
        if self._starts_warm != self._warm:
            self._starts_warm = self._warm
            solver.settings.initial_guess = _WARM if self._starts_warm else _COLD
        size = _length(problem.gradient)
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
        x, multipliers = results.x, results.z
        self.multipliers = multipliers
        if size != 1.0:
            self.multipliers = multipliers = size * multipliers
        z = problem.accepted(x, multipliers)
        self._warm = z is not None and not (self._starts_warm and results.info.iter > _MANY_ITERATIONS)
        if z is not None:
            self._last = z, np.array(multipliers)
            return z
        self._last = None
        if not (np.isfinite(x).all() and np.isfinite(multipliers).all()):
            self._start_afresh(_STEP_SIZES[-1])
            return None
        return self._corrected(problem, x, multipliers)

    def _with_the_same_constraints(self, problem: Problem, x: Array, multipliers: Array) -> Array | None:
        """Return the optimum if the constraints that were active last are so again; None otherwise."""
        step = kernels.active_set_step(*problem, x, multipliers)
        if step is None:
            return None
        answer = problem.accepted(*step)
        if answer is not None:
            self._last, self.multipliers = step, step[1]
        return answer

    def _corrected(self, problem: Problem, x: Array, multipliers: Array) -> Array | None:
        """Return the optimum, from a nearly optimal x and multipliers of rows and box; None when it is not found."""
        for _ in range(_MOST_CORRECTIONS):
            x, multipliers = kernels.active_set_step(*problem, x, multipliers) or _least_squares_step(
                problem, x, multipliers
            )
            z = problem.accepted(x, multipliers)
            if z is not None:
                self._last, self.multipliers = (x, multipliers), multipliers
                return z
        return None


def _least_squares_step(problem: Problem, x: Array, multipliers: Array) -> tuple[Array, Array]:
    """Return what ``kernels.active_set_step`` does, where the active constraints depend on each other."""
    active, equations, right = active_equations(*problem, x, multipliers)
    solution: Array = np.asarray(np.linalg.lstsq(equations, right, rcond=1e-13)[0], dtype=float)
    found = np.zeros_like(multipliers)
    found[active] = solution[x.size :]
    return solution[: x.size], found
