"""Factors and solutions for arrays of symbols, and the kernels of the control step on them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import lapack

from phcontrol.compilation.symbol import SymbolArray, is_symbolic, refuse, sample_of, symbols

_SHARE = 0.1  # of the largest entry of a column, below which a pivot is not trusted


def factor(mass_matrix: Any) -> SymbolArray:
    """Return T of M = T Tᵀ; guarded against an M that is not positive definite."""
    n, T = len(mass_matrix), symbols(np.zeros(np.shape(mass_matrix)))
    for j in range(n):
        for i in range(j, n):
            total = mass_matrix[i, j]
            for k in range(j):
                total = total - T[i, k] * T[j, k]
            if i > j:
                T[i, j] = total / T[j, j]
            elif total > 0.0:
                T[j, j] = total**0.5
            else:
                raise ArithmeticError("the matrix is not positive definite")
    return T


def solve(T: Any, right: Any) -> SymbolArray:
    """Return T⁻¹b for a vector or the columns of a matrix."""
    result = symbols(right)
    for i in range(len(T)):
        for k in range(i):
            result[i] = result[i] - T[i, k] * result[k]
        result[i] = result[i] / T[i, i]
    return result


def solve_transposed(T: Any, right: Any) -> SymbolArray:
    """Return T⁻ᵀb for a vector or the columns of a matrix."""
    result = symbols(right)
    for i in reversed(range(len(T))):
        result[i] = result[i] / T[i, i]
        for k in range(i):
            result[k] = result[k] - T[i, k] * result[i]
    return result


def _lower_half(T: Any, matrix: Any) -> SymbolArray:
    """Return Φ(T⁻¹S T⁻ᵀ) of a symmetric S: its lower triangle, the diagonal halved."""
    n, reduced = len(T), solve(T, matrix)
    result = symbols(np.zeros((n, n)))
    for i in range(n):
        for j in range(i + 1):  # row i times T⁻ᵀ, as far as the diagonal
            total = reduced[i, j]
            for k in range(j):
                total = total - T[j, k] * result[i, k]
            result[i, j] = total / T[j, j]
        result[i, i] = 0.5 * result[i, i]
    return result


def relative_factor_rate(T: Any, coriolis: Any) -> SymbolArray:
    """Return T⁻¹Ṫ = Φ(T⁻¹(C + Cᵀ)T⁻ᵀ)."""
    return _lower_half(T, coriolis + coriolis.T)


def transformed_rate(T: Any, coriolis: Any, velocity: Any, force: Any) -> Any:
    """Return Ṫᵀs + T⁻¹(f − C s)."""
    rate = velocity.dot(T).dot(relative_factor_rate(T, coriolis))
    result: SymbolArray = rate + solve(T, force - coriolis.dot(velocity))
    return result


def momentum_derivative(T: Any, mass_matrix_derivative: Any, momentum: Any) -> SymbolArray:
    """Return P: column k is −Φ(T⁻¹(∂M/∂q_k)T⁻ᵀ)p̄."""
    rows = symbols([-_lower_half(T, matrix).dot(momentum) for matrix in mass_matrix_derivative])
    result: SymbolArray = rows.T.view(SymbolArray)
    return result


def feedback(force: Any, stiffness: Any, error: Any, damping: Any, velocity: Any, desired: Any) -> Any:
    """Return f − K e − C(v − s)."""
    return force - stiffness.dot(error) - damping.dot(velocity - desired)


class Elimination(NamedTuple):
    """The triangular factors of a matrix whose rows were taken in an order."""

    factors: Any
    order: list[int]


def eliminate(matrix: Any) -> Elimination:
    """Return triangular factors of a square matrix.

    A symmetric positive definite one needs no order of rows; its pivots are guarded to stay positive. Of others the
    pivots are those of the sample, each guarded to stay above a tenth of its column.
    """
    work, n = symbols(matrix), len(matrix)
    samples = np.array([[sample_of(entry) for entry in row] for row in work])
    definite = np.allclose(samples, samples.T, rtol=1e-9, atol=1e-300) and np.linalg.eigvalsh(samples)[0] > 0.0
    order = list(range(n))
    for j in range(n):
        if not definite:
            pivot = max(range(j, n), key=lambda row: abs(sample_of(work[row, j])))
            work[[j, pivot]], order[j], order[pivot] = work[[pivot, j]], order[pivot], order[j]
            if any(abs(work[i, j]) * _SHARE > abs(work[j, j]) for i in range(j + 1, n)) or work[j, j] == 0.0:
                refuse("a linear system is singular at the sample")
        elif not work[j, j] > 0.0:
            refuse("a linear system is singular at the sample")
        for i in range(j + 1, n):
            if type(work[i, j]) is float and work[i, j] == 0.0:
                continue
            work[i, j] = work[i, j] / work[j, j]
            for k in range(j + 1, n):
                work[i, k] = work[i, k] - work[i, j] * work[j, k]
    return Elimination(work, order)


def substitute(found: Elimination, right: Any) -> SymbolArray:
    """Return A⁻¹b for a vector or the columns of a matrix, of the factors of A."""
    factors, n = found.factors, len(found.order)
    result = symbols(right)[found.order].view(SymbolArray)
    for i in range(n):
        for k in range(i):
            result[i] = result[i] - factors[i, k] * result[k]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            result[i] = result[i] - factors[i, k] * result[k]
        result[i] = result[i] / factors[i, i]
    return result


def solve_square(matrix: Any, right: Any) -> Any:
    """Return A⁻¹b."""
    return substitute(eliminate(matrix), right)


# --- LAPACK's names -----------------------------------------------------------------------------------


def dgetrf(matrix: Any, *rest: Any, **options: Any) -> Any:
    """Return triangular factors as LAPACK does: factors, order, and 0."""
    if not is_symbolic(matrix):
        return lapack.dgetrf(matrix, *rest, **options)
    found = eliminate(matrix)
    return found.factors, found.order, 0


def dgetrs(factors: Any, order: Any, right: Any, *rest: Any, **options: Any) -> Any:
    """Return A⁻¹b of the factors of A, and 0; A or b may be plain numbers."""
    if not (is_symbolic(factors) or is_symbolic(right)):
        return lapack.dgetrs(factors, order, right, *rest, **options)
    if not is_symbolic(factors):
        return lapack.dgetrs(factors, order, np.eye(len(factors)))[0].dot(right), 0
    return substitute(Elimination(factors, list(order)), right), 0


def dpotrf(matrix: Any, *rest: Any, **options: Any) -> Any:
    """Return T of M = T Tᵀ, and 0, or 1 where M is not positive definite at the sample."""
    if not is_symbolic(matrix):
        return lapack.dpotrf(matrix, *rest, **options)
    try:
        return factor(matrix), 0
    except ArithmeticError:
        return matrix, 1


def dtrtrs(T: Any, right: Any, lower: int, transposed: int = 0) -> Any:
    """Return T⁻¹b or T⁻ᵀb of a lower triangular T, and 0."""
    if not (is_symbolic(T) or is_symbolic(right)):
        return lapack.dtrtrs(T, right, lower, transposed)
    return (solve_transposed if transposed else solve)(T, right), 0


def dtrtri(T: Any, *rest: Any, **options: Any) -> Any:
    """Return the inverse of a lower triangular matrix, and 0."""
    return (solve(T, np.eye(len(T))), 0) if is_symbolic(T) else lapack.dtrtri(T, *rest, **options)


def dpotrs(T: Any, right: Any, *rest: Any, **options: Any) -> Any:
    """Return (T Tᵀ)⁻¹b, and 0."""
    if not (is_symbolic(T) or is_symbolic(right)):
        return lapack.dpotrs(T, right, *rest, **options)
    return solve_transposed(T, solve(T, right)), 0
