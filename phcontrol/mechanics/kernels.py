"""The inner products of the control step, by compiled code where it was built, else by LAPACK.

Both are the same formulas, tested against each other and against independent ones; the compiled one saves a
dozen calls of a microsecond each. With T lower triangular, M = T Tᵀ, and Φ(X) the lower triangle of X with its
diagonal halved:

    factor(M)                            T; ArithmeticError unless M is positive definite
    solve(T, b), solve_transposed(T, b)  T⁻¹b, T⁻ᵀb for a vector or the columns of a matrix b
    relative_factor_rate(T, C)           T⁻¹Ṫ = Φ(T⁻¹(C + Cᵀ)T⁻ᵀ)
    transformed_rate(T, C, s, f)         Ṫᵀs + T⁻¹(f − C s)
    momentum_derivative(T, ∂M/∂q, p̄)     P = ∂(T⁻¹p)/∂q: column k is −Φ(T⁻¹(∂M/∂q_k)T⁻ᵀ)p̄
    feedback(f, K, e, C, v, s)           f − K e − C(v − s)
    damping_root(L, B, ζ)                X = (2ζ)^½ L U S^(−¼), with LᵀBL = U S Uᵀ, S at least 10⁻¹² of its largest
    finite_copy(v, n)                    a copy of a plain float64 (n,) array of finite numbers; None for anything else

Arrays are float64, (n,), (n, n) or (n, n, n) with any strides; ValueError otherwise. The environment variable
``PHCONTROL_KERNELS=lapack`` chooses LAPACK, ``PHCONTROL_KERNELS=compiled`` insists on the compiled one.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

__all__ = [
    "KERNELS",
    "damping_root",
    "factor",
    "feedback",
    "finite_copy",
    "momentum_derivative",
    "relative_factor_rate",
    "solve",
    "solve_transposed",
    "transformed_rate",
]

_choice = os.environ.get("PHCONTROL_KERNELS", "")
if _choice not in ("", "compiled", "lapack"):
    raise ImportError(f"PHCONTROL_KERNELS must be 'compiled' or 'lapack', but is '{_choice}'")

if TYPE_CHECKING or _choice == "lapack":
    from phcontrol.mechanics import _lapack as _chosen
else:
    try:
        from phcontrol.mechanics import _compiled as _chosen
    except ImportError as error:
        if _choice == "compiled":
            raise ImportError("PHCONTROL_KERNELS is 'compiled', but the kernels were not built") from error
        from phcontrol.mechanics import _lapack as _chosen

KERNELS = _chosen.__name__.rpartition("._")[-1]
"""Which kernels are in use: "compiled" or "lapack"."""

damping_root = _chosen.damping_root
factor = _chosen.factor
feedback = _chosen.feedback
finite_copy = _chosen.finite_copy
momentum_derivative = _chosen.momentum_derivative
relative_factor_rate = _chosen.relative_factor_rate
solve = _chosen.solve
solve_transposed = _chosen.solve_transposed
transformed_rate = _chosen.transformed_rate
