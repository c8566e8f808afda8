"""The quadratic programs of the torque filter, on ProxQP, with answers that are checked."""

from __future__ import annotations

import atexit
import math
import weakref
from typing import Any, NamedTuple

import numpy as np
from proxsuite import proxqp

from phcontrol._validation import Array
from phcontrol.safety import kernels
from phcontrol.safety._numpy import active_equations

ACCURACY = 1e-10
"""What is asked of the solver, in scaled units."""
ACCEPTED = 1e-10
"""The largest residual of an answer that is believed, in scaled units, but for the rounding of large numbers."""

UNBOUNDED = 1e20
"""What ProxQP takes for no bound."""

_ROUNDING = 1e-14  # of sums of gradient and forces, relative to them
_MOST_ITERATIONS = 60
_MANY_ITERATIONS = 8  # of a warm start, after which the next is cold, with the solver's own step sizes
_LARGE_GRADIENT = 20.0  # from which the objective is scaled
_MOST_CORRECTIONS = 6
_MOST_STEPS = 100  # of the active-set method from a feasible point
_AT_REST = 1e-12  # of a step, in scaled units
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
        if stationary <= ACCEPTED:
            return True
        return stationary <= _ROUNDING * (_length(self.gradient) + _length(multipliers))


_programs: weakref.WeakSet[QuadraticProgram] = weakref.WeakSet()


@atexit.register
def _end_solvers() -> None:
    """Let go of all solvers: nanobind complains, in pages, of those that a thread or a cycle keeps until the end."""
    for program in list(_programs):
        program.end()


class QuadraticProgram:
    """Solves one :class:`Problem` of n unknowns and m rows after another, each started from the last answer.

    Mostly the constraints that were active last are active again: then one set of equations gives the optimum, and
    ProxQP is not asked. An answer counts only if the residuals of the optimality conditions, computed here, are below
    ``ACCEPTED``. Where ProxQP's is not that exact, the equations of the constraints that it found active are solved
    directly, the active constraints are corrected by that solution, and so on (a primal-dual active-set method); where
    that fails too, a primal active-set method goes on from a feasible point, if one is known. All results are checked
    likewise. Four traps of ProxQP are avoided: with its own threshold for infeasibility (1e-4) it gives up problems
    that have solutions; a large gradient beside bounds of order one spoils it, so that the objective is scaled here;
    what a problem without a solution leaves spoils the next start, so that a new solver is made; and on contradictory
    bounds it would iterate for half a second.
    """

    def __init__(self, n: int, m: int) -> None:
        _programs.add(self)
        self._n, self._m = n, m
        self._identity = np.eye(n)
        self.reset()

    def reset(self) -> None:
        """Forget the last answer."""
        self._start_afresh()
        self._last: tuple[Array, Array] | None = None

    @property
    def multipliers(self) -> Array:
        """Of rows and box, of the last answer; none before the first."""
        return np.zeros(self._m + self._n) if self._last is None else self._last[1]

    def _start_afresh(self) -> None:
        """Make a new solver: after a failure an old one mostly fails again."""
        n, m = self._n, self._m
        solver = proxqp.dense.QP(n, 0, m, True, proxqp.dense.HessianType.Dense)
        settings = solver.settings
        settings.eps_abs, settings.eps_rel, settings.max_iter = ACCURACY, 0.0, _MOST_ITERATIONS
        settings.max_iter_in = _MOST_INNER_ITERATIONS
        settings.eps_primal_inf = settings.eps_dual_inf = 0.0
        settings.check_duality_gap, settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = True, ACCURACY, 0.0
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

    def solve(self, problem: Problem, feasible: Array | None = None) -> Array | None:
        """Return the optimum, exactly inside the box, or None when no answer passes the check.

        Args:
            problem: what to solve.
            feasible: a z that meets all constraints, if one is known, for where ProxQP fails.
        """
        answer = None if self._last is None else self._with_the_same_constraints(problem, *self._last)
        if answer is None:
            answer = self._attempt(problem)
        if answer is None:
            self._start_afresh()
            if feasible is not None:
                answer = self._from_feasible(problem, feasible)
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
        x, multipliers = results.x, size * results.z
        z = problem.accepted(x, multipliers)
        self._warm = z is not None and not (self._starts_warm and results.info.iter > _MANY_ITERATIONS)
        if z is not None:
            return self._settled(problem, z, multipliers)
        self._last = None
        if not (np.isfinite(x).all() and np.isfinite(multipliers).all()):
            return None
        return self._corrected(problem, x, multipliers)

    def _settled(self, problem: Problem, x: Array, multipliers: Array) -> Array | None:
        """Return an answer that is optimal but for rounding, as exact as its active constraints give it, or None."""
        solved = kernels.active_set_step(*problem, x, multipliers) or (x, multipliers)
        for step in (_touching(problem, *solved), solved, (x, multipliers)):
            answer = self._believed(problem, step)
            if answer is not None:
                return answer
        return None

    def _believed(self, problem: Problem, step: tuple[Array, Array]) -> Array | None:
        """Return and remember what x and multipliers give if that passes the check, else None."""
        answer = problem.accepted(*step)
        if answer is not None:
            self._last = step
        return answer

    def _with_the_same_constraints(self, problem: Problem, x: Array, multipliers: Array) -> Array | None:
        """Return the optimum if the constraints that were active last are so again; None otherwise."""
        step = kernels.active_set_step(*problem, x, multipliers)
        return None if step is None else self._believed(problem, step)

    def _from_feasible(self, problem: Problem, z: Array) -> Array | None:
        """Return the optimum by a primal active-set method from a feasible z; None when that does not get there.

        It keeps to the constraints it has met: to the optimum on those, as far as no other is in the way; there,
        the one that holds it back most wrongly is let go (Nocedal and Wright, Numerical Optimization, section 16.5).
        """
        n, m = z.size, problem.lower.size
        constraints = np.vstack([problem.rows, np.eye(n)])
        low, high = np.append(problem.lower, problem.lowest), np.append(problem.upper, problem.highest)
        hessian = np.eye(n) if problem.hessian is None else problem.hessian
        held: list[int] = []
        for _ in range(_MOST_STEPS):
            A = constraints[held]
            equations = np.block([[hessian, A.T], [A, np.zeros((len(held), len(held)))]])
            right = np.append(-(hessian.dot(z) + problem.gradient), np.zeros(len(held)))
            solution = np.linalg.solve(equations, right)
            step, forces = solution[:n], solution[n:]
            rates, values = constraints.dot(step), constraints.dot(z)
            rates[held] = 0.0
            ways = np.full(rates.size, np.inf)
            rising, falling = rates > _AT_REST, rates < -_AT_REST
            ways[rising] = (high - values)[rising] / rates[rising]
            ways[falling] = (low - values)[falling] / rates[falling]
            nearest = int(np.argmin(ways))
            z = z + min(1.0, max(0.0, ways[nearest])) * step
            if ways[nearest] < 1.0:
                held.append(nearest)
                continue
            at_upper = A.dot(z) - 0.5 * (low[held] + high[held]) > 0.0
            wrong = np.where(at_upper, -forces, forces)
            if held and wrong.max() > 0.0:
                del held[int(np.argmax(wrong))]
                continue
            multipliers = np.zeros(m + n)
            multipliers[held] = forces
            return self._settled(problem, z, multipliers)
        return None

    def _corrected(self, problem: Problem, x: Array, multipliers: Array) -> Array | None:
        """Return the optimum, from a nearly optimal x and multipliers of rows and box; None when it is not found."""
        for _ in range(_MOST_CORRECTIONS):
            x, multipliers = kernels.active_set_step(*problem, x, multipliers) or _least_squares_step(
                problem, x, multipliers
            )
            answer = self._believed(problem, (x, multipliers))
            if answer is not None:
                return answer
        return None


def _least_squares_step(problem: Problem, x: Array, multipliers: Array) -> tuple[Array, Array]:
    """Return what ``kernels.active_set_step`` does, where the active constraints depend on each other."""
    active, equations, right, scale = active_equations(*problem, x, multipliers)
    solution: Array = np.asarray(np.linalg.lstsq(equations, right, rcond=1e-13)[0], dtype=float)
    found = np.zeros_like(multipliers)
    found[active] = scale * solution[x.size :]
    return solution[: x.size], found


def _touching(problem: Problem, z: Array, multipliers: Array) -> tuple[Array, Array]:
    """Return z moved onto its active constraints exactly, and the forces that balance it there.

    Where constraints are nearly dependent (forces of 10⁸ and more), that is closer than all equations at once get.
    """
    n = z.size
    active, equations, right, scale = active_equations(*problem, z, multipliers)
    A, bounds = equations[n:, :n], right[n:]
    moved: Array = z + np.linalg.lstsq(A, bounds - A.dot(z), rcond=None)[0]
    downhill = right[:n] - equations[:n, :n].dot(moved)
    forces = np.zeros_like(multipliers)
    forces[active] = scale * np.linalg.lstsq(A.T, downhill, rcond=None)[0]
    return moved, forces
