"""The torque filter's program: linear bounds, and one convex quadratic condition that may be relaxed."""

from __future__ import annotations

import math

import numpy as np

from phcontrol._validation import Array
from phcontrol.safety import kernels
from phcontrol.safety.filter_status import FilterStatus
from phcontrol.safety.problem import Problem
from phcontrol.safety.quadratic_constraint import QuadraticConstraint
from phcontrol.safety.quadratic_program import QuadraticProgram, SolverName

_INSISTENCE = 1e6  # weight of the quadratic condition against distance, once it cannot be met
_MOST_TANGENTS = 8
_TOUCHING = 1e-12  # by which an answer may miss the quadratic constraint, and the balance of forces on it
_SEARCH_STEPS = 60  # for the right weight, where the tangents fail


class TorqueProgram:
    """min ½zᵀH z + gᵀz subject to l ≤ C z ≤ u, a ≤ z ≤ b and, if possible, a :class:`QuadraticConstraint`.

    By Newton's method: the constraint is replaced by its tangent, its curvature goes with the last multiplier into
    the objective, and each quadratic program is solved and checked by :class:`QuadraticProgram`. A tangent allows all
    that the constraint allows, so a program without a solution proves that there is none. Where it cannot be met, or
    that is not sure, the constraint's left side goes into the objective with a weight of 10⁶ instead, which brings
    it to within about 10⁻⁵ of its smallest value, and reports whether that is above 0.

    Args:
        n: number of unknowns; as many rows C.
        solver: that is asked first.
    """

    def __init__(self, n: int, solver: SolverName = "daqp") -> None:
        self._n = n
        self.rows = np.zeros((n + 1, n))
        """C, to be written before each solution, and a row for the tangent."""
        self.lower, self.upper = np.zeros(n + 1), np.zeros(n + 1)
        self._bounded, self._free = QuadraticProgram(n, n + 1, solver), QuadraticProgram(n, n, solver)
        self.reset()

    def reset(self) -> None:
        """Forget the last answer."""
        self._bounded.reset()
        self._free.reset()
        self._start: Array | None = None
        self._weight = 0.0
        self._relaxed = False

    @property
    def is_constrained(self) -> bool:
        """Whether the quadratic constraint was in the way of the last answer, or relaxed."""
        return self._relaxed or self._weight > 0.0

    def solve(
        self, free: Problem, feasible: Array, constraint: QuadraticConstraint | None = None
    ) -> tuple[FilterStatus, Array | None]:
        """Return z and how it was found; None when no answer passes the check; ``feasible`` meets ``free``."""
        if constraint is None:
            answer = self._free.solve(free, feasible)
            return (FilterStatus.FALLBACK if answer is None else FilterStatus.SOLVED), answer
        insisted = self._insisted(free, constraint, feasible) if self._relaxed else None
        if insisted is not None and _proves(free, constraint, insisted):
            return FilterStatus.STORAGE_RELAXED, insisted
        self._relaxed = False
        answer = self._by_tangents(free, constraint)
        if answer is not None:
            return FilterStatus.SOLVED, answer
        self._start, self._weight = None, 0.0
        if insisted is None:
            insisted = self._insisted(free, constraint, feasible)
        if insisted is None:
            return FilterStatus.FALLBACK, None
        if constraint.value(insisted) <= 0.0:
            answer = self._by_tangents(free, constraint, insisted)
            return self._by_insistence(free, constraint, insisted) if answer is None else (FilterStatus.SOLVED, answer)
        self._relaxed = True
        return FilterStatus.STORAGE_RELAXED, insisted

    def _insisted(
        self, free: Problem, constraint: QuadraticConstraint, feasible: Array, weight: float = _INSISTENCE
    ) -> Array | None:
        """Return the optimum with the constraint's left side, weighed, in the objective."""
        centre, _, slope, curvature = constraint
        bent = kernels.bent(free.hessian, free.gradient, weight, curvature, centre, slope)
        return self._free.solve(Problem(*bent, *free[2:]), feasible)

    def _bent(self, free: Problem, constraint: QuadraticConstraint, weight: float, z: Array) -> Problem:
        """Return the problem with ½·weight·(y − z)ᵀK(y − z) in the objective, K the constraint's curvature."""
        hessian, gradient = kernels.bent(free.hessian, free.gradient, weight, constraint.curvature, z, None)
        return Problem(hessian, gradient, *free[2:])

    def _by_tangents(
        self, free: Problem, constraint: QuadraticConstraint, feasible: Array | None = None
    ) -> Array | None:
        """Return the optimum, or None when there is none or it is not found.

        A ``feasible`` z that meets the constraint, and so all its tangents, helps where the solver fails.
        """
        n, rows, lower, upper = self._n, self.rows, self.lower, self.upper
        z, weight = constraint.centre if self._start is None else self._start, self._weight
        for _ in range(_MOST_TANGENTS):
            row, bound, length = constraint.tangent(z)
            extent = float(np.abs(row).dot(free.highest))
            if bound < -extent:
                return None
            rows[n], lower[n], upper[n] = row, -extent - 1.0, min(bound, extent + 1.0)
            bent = self._bent(free, constraint, weight, z) if weight > 0.0 else free
            answer = self._bounded.solve(Problem(bent[0], bent[1], rows, lower, upper, *free[5:]), feasible)
            if answer is None:
                return None
            found = max(0.0, float(self._bounded.multipliers[n])) / length if length else 0.0
            step = answer - z
            bend = constraint.curvature.dot(step)
            # exact: the tangent at z and the weight that it was given are those of the answer
            missed = constraint.value(answer) if found == 0.0 else 0.5 * float(step.dot(bend))
            if abs(found - weight) * math.sqrt(bend.dot(bend)) <= _TOUCHING and missed <= _TOUCHING:
                self._start, self._weight = (answer, found) if found else (None, 0.0)
                return answer
            z, weight = answer, found
        return None

    def _by_insistence(
        self, free: Problem, constraint: QuadraticConstraint, answer: Array
    ) -> tuple[FilterStatus, Array]:
        """Return z by a search for the weight with which insisting just meets the constraint, as ``answer`` does."""
        too_little, enough = 1e-6, _INSISTENCE
        for _ in range(_SEARCH_STEPS):
            weight = math.sqrt(too_little * enough)
            found = self._insisted(free, constraint, answer, weight)
            if found is None:
                break
            value = constraint.value(found)
            if value > 0.0:
                too_little = weight
                continue
            enough, answer = weight, found
            if value >= -_TOUCHING:
                return FilterStatus.SOLVED, answer
        return FilterStatus.FEASIBLE, answer


def _proves(free: Problem, constraint: QuadraticConstraint, insisted: Array) -> bool:
    """Whether an insisting answer z proves that the constraint cannot be met.

    z minimises φ(y) + ρ q(y), φ the distance. So any y has q(y) ≥ q(z) − (max φ − φ(z))/ρ, the maximum over the box.
    """
    more = kernels.farther(free.hessian, free.gradient, insisted, free.highest)
    return constraint.value(insisted) > more / _INSISTENCE
