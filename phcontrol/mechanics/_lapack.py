"""The kernels of the control step on NumPy and LAPACK: where no compiler was at hand, and as their own check."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg import lapack

from phcontrol._validation import Array
from phcontrol.mechanics.derivatives import lower_half

_FLOAT = np.dtype(np.float64)
_dpotrf, _dtrtrs, _dtrtri, _dsygst = lapack.dpotrf, lapack.dtrtrs, lapack.dtrtri, lapack.dsygst


@lru_cache
def _mask(size: int) -> Array:
    """Return what Φ multiplies a matrix with, entry by entry."""
    return np.asfortranarray(lower_half(np.ones((size, size))))


def factor(mass_matrix: Array) -> Array:
    """Return T; ArithmeticError unless M is positive definite."""
    result: Array
    result, info = _dpotrf(mass_matrix.T, 1, 1)  # lower, zeros above
    diagonal = result.diagonal()
    if info or not math.isfinite(diagonal.dot(diagonal)):  # OpenBLAS lets NaN pass
        raise ArithmeticError("the matrix is not positive definite")
    return result


def solve(factor: Array, right: Array) -> Array:
    """Return T⁻¹b for a vector or the columns of a matrix."""
    result: Array = _dtrtrs(factor, right, 1)[0]
    return result


def solve_transposed(factor: Array, right: Array) -> Array:
    """Return T⁻ᵀb for a vector or the columns of a matrix."""
    result: Array = _dtrtrs(factor, right, 1, 1)[0]
    return result


def relative_factor_rate(factor: Array, coriolis: Array) -> Array:
    """Return T⁻¹Ṫ = Φ(T⁻¹(C + Cᵀ)T⁻ᵀ)."""
    rate: Array = _dsygst(coriolis + coriolis.T, factor, 1, 1)[0]  # fills the lower triangle only
    rate *= _mask(len(rate))
    return rate


def transformed_rate(factor: Array, coriolis: Array, velocity: Array, force: Array) -> Array:
    """Return Ṫᵀs + T⁻¹(f − C s)."""
    rate: Array = velocity.dot(factor).dot(relative_factor_rate(factor, coriolis))
    return rate + solve(factor, force - coriolis.dot(velocity))


def momentum_derivative(factor: Array, mass_matrix_derivative: Array, momentum: Array) -> Array:
    """Return P: column k is −Φ(T⁻¹(∂M/∂q_k)T⁻ᵀ)p̄."""
    inverse = _dtrtri(factor, lower=1)[0]
    reduced = inverse @ mass_matrix_derivative @ inverse.T
    reduced *= _mask(len(inverse))
    result: Array = -np.ascontiguousarray(reduced.dot(momentum).T)
    return result


def feedback(force: Array, stiffness: Array, error: Array, damping: Array, velocity: Array, desired: Array) -> Array:
    """Return f − K e − C(v − s)."""
    result: Array = force - stiffness.dot(error)
    result -= damping.dot(velocity - desired)
    return result


def finite_copy(value: Any, size: int) -> Array | None:
    """Return a copy of a plain float64 vector of finite numbers, None for anything else."""
    if (
        type(value) is np.ndarray
        and value.dtype is _FLOAT
        and value.shape == (size,)
        and value.flags.aligned
        # NaN or infinity makes the sum so; so may finite numbers close to the largest
        and (math.isfinite(sum(value.tolist())) or np.isfinite(value).all())
    ):
        copy: Array = value.copy()
        return copy
    return None
