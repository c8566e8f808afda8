"""The quadratic programs of the torque filter, on one of two solvers, with answers that are checked."""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.safety import kernels
from phcontrol.safety._numpy import active_equations
from phcontrol.safety.daqp_solver import DaqpSolver
from phcontrol.safety.problem import Problem
from phcontrol.safety.proxqp_solver import ProxqpSolver

SolverName = Literal["daqp", "proxqp"]
SOLVERS: dict[SolverName, type[DaqpSolver] | type[ProxqpSolver]] = {"daqp": DaqpSolver, "proxqp": ProxqpSolver}
"""By name, the default first."""

_MOST_CORRECTIONS = 6
_FEW_CORRECTIONS = 3  # of the last answer, before a solver is asked
_TOUCHING = 1e-13  # by which an answer may miss its active constraints without being moved onto them
_MOST_STEPS = 100  # of the active-set method from a feasible point
_AT_REST = 1e-12  # of a step, in scaled units


class Solver(Protocol):
    """What solves a :class:`Problem`; its answers need not be right."""

    @property
    def found_none(self) -> bool:
        """Whether the last answer was that no point meets the constraints."""
        ...

    def solve(self, problem: Problem) -> tuple[Array, Array] | None:
        """Return x and the multipliers of rows and box, or None."""
        ...

    def reset(self) -> None:
        """Forget the last answer."""
        ...


class QuadraticProgram:
    """Solves one :class:`Problem` of n unknowns and m rows after another, each started from the last answer.

    Mostly the constraints that were active last are active again, but for a few: then a set of equations or two give
    the optimum, and no solver is asked. An answer counts only if the residuals of the optimality conditions, computed
    here, are below ``ACCEPTED``. Where a solver's is not that exact, the equations of the constraints that it found
    active are solved directly, the active constraints are corrected by that solution, and so on (a primal-dual
    active-set method); where that fails too, the other solver is asked, and then a primal active-set method goes on
    from a feasible point, if one is known. All results are checked likewise. That no point meets the constraints is
    believed of a solver that says so only where none is known: then the answer is None too.

    Args:
        n: number of unknowns.
        m: number of rows.
        solver: that is asked first: "daqp" or "proxqp".
    """

    def __init__(self, n: int, m: int, solver: SolverName = "daqp") -> None:
        self._n, self._m = n, m
        self._solvers: list[Solver] = [make(n, m) for make in ordered(solver)]
        self._last: tuple[Array, Array] | None = None

    def reset(self) -> None:
        """Forget the last answer."""
        for solver in self._solvers:
            solver.reset()
        self._last = None

    @property
    def multipliers(self) -> Array:
        """Of rows and box, of the last answer; none before the first."""
        return np.zeros(self._m + self._n) if self._last is None else self._last[1]

    def solve(self, problem: Problem, feasible: Array | None = None) -> Array | None:
        """Return the optimum, exactly inside the box, or None when no answer passes the check.

        Args:
            problem: what to solve.
            feasible: a z that meets all constraints, if one is known, for where the solvers fail.
        """
        answer = None if self._last is None else self._from_the_last(problem, *self._last)
        if answer is not None:
            return answer
        for solver in self._solvers:
            answer = self._attempt(solver, problem)
            if answer is not None:
                return answer
            if solver.found_none and feasible is None:
                return None
            solver.reset()
        return None if feasible is None else self._from_feasible(problem, feasible)

    def _attempt(self, solver: Solver, problem: Problem) -> Array | None:
        """Return a solver's answer, made exact, or None."""
        found = solver.solve(problem)
        if found is None or not (np.isfinite(found[0]).all() and np.isfinite(found[1]).all()):
            return None
        z = problem.accepted(*found)
        if z is not None:
            return self._settled(problem, z, found[1])
        self._last = None
        return self._corrected(problem, *found)

    def _settled(self, problem: Problem, x: Array, multipliers: Array) -> Array | None:
        """Return an answer that is optimal but for rounding, as exact as its active constraints give it, or None."""
        renewed = kernels.active_set_step(*problem, x, multipliers)
        if renewed is not None and renewed[4] <= _TOUCHING and problem.are_small(*renewed[3:], renewed[1]):
            self._last = renewed[:2]
            return renewed[2]
        solved = (x, multipliers) if renewed is None else renewed[:2]
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

    def _from_the_last(self, problem: Problem, x: Array, multipliers: Array) -> Array | None:
        """Return the optimum if the constraints that were active last are so again, but for a few; None otherwise."""
        for _ in range(_FEW_CORRECTIONS):
            step = kernels.active_set_step(*problem, x, multipliers)
            if step is None:
                return None
            x, multipliers, z, stationary, complementary = step
            if problem.are_small(stationary, complementary, multipliers):
                self._last = x, multipliers
                return z
        return None

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
            step = kernels.active_set_step(*problem, x, multipliers)
            x, multipliers = _least_squares_step(problem, x, multipliers) if step is None else step[:2]
            answer = self._believed(problem, (x, multipliers))
            if answer is not None:
                return answer
        return None


def ordered(solver: SolverName) -> list[type[DaqpSolver] | type[ProxqpSolver]]:
    """Return the solvers in the order in which they are asked: that of this name, then the other."""
    if not isinstance(solver, str) or solver not in SOLVERS:
        raise InvalidArgumentError("solver", f"must be one of {', '.join(map(repr, SOLVERS))}, but is {solver!r}")
    return [SOLVERS[solver], *(make for name, make in SOLVERS.items() if name != solver)]


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
