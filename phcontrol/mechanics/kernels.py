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
    finite_copy(v, n)                    a copy of a plain float64 (n,) array of finite numbers; None for anything else

About a frame, with 𝒥 of m rows, W = T⁻¹𝒥ᵀ and B = WᵀW (by ``_compiled_frames.c``, else ``_numpy_frames.py``):

    frame_wrench(r, R, r_d, R_d, K, F, M)  (K(r − r_d) + F, vee(Y − Yᵀ)), Y = R_d M Rᵀ; None for 0, and for R_d = 1
    task_space(𝒥, T, H)                  W, B, A = 𝒥𝒥ᵀ and (tr Y⁴)^½ of Y = HᵀA⁻¹H, inf unless A is positive definite
    modes(A, doubt, otherwise)           eigenvalues, the smallest first, and their vectors (always LAPACK's)
    without_task(𝒥, T, W, B, f)          f − 𝒥ᵀB⁻¹WᵀT⁻¹f
    hand_damping(𝒥, X, B, M, v, d)       𝒥ᵀ(XXᵀ − d B⁻¹)𝒥v + d M v
    damping_root(L_t, L_r, R, B, ζ)      X = (2ζ)^½ L U S^(−¼), L of L_t and R L_r, with LᵀBL = U S Uᵀ, S at least 10⁻¹²
                                         of its largest; None for L_r and R where the orientation is free
    right_inverse_motion(B, Ḃ, A, Ȧ, w, ẇ)  s = BᵀA⁻¹w and ṡ; None for Ȧ where A = BBᵀ; NaN where A is singular
    curve_point(table, k, s, ṡ, s̈, turned)  r, R, ξ and ξ̇ on a ``CurvedPath``

Arrays are float64, (n,), (n, n) or (n, n, n) with any strides; ValueError otherwise. The environment variable
``PHCONTROL_KERNELS=lapack`` chooses LAPACK, ``PHCONTROL_KERNELS=compiled`` insists on the compiled one.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from phcontrol.mechanics import _numpy_frames

__all__ = [
    "KERNELS",
    "curve_point",
    "damping_root",
    "factor",
    "feedback",
    "finite_copy",
    "frame_wrench",
    "hand_damping",
    "modes",
    "momentum_derivative",
    "relative_factor_rate",
    "right_inverse_motion",
    "solve",
    "solve_transposed",
    "task_space",
    "transformed_rate",
    "without_task",
]

_choice = os.environ.get("PHCONTROL_KERNELS", "")
if _choice not in ("", "compiled", "lapack"):
    raise ImportError(f"PHCONTROL_KERNELS must be 'compiled' or 'lapack', but is '{_choice}'")

if TYPE_CHECKING or _choice == "lapack":
    from phcontrol.mechanics import _lapack as _chosen
    from phcontrol.mechanics import _numpy_frames as _frames
else:
    try:
        from phcontrol.mechanics import _compiled as _chosen
        from phcontrol.mechanics import _compiled_frames as _frames
    except ImportError as error:
        if _choice == "compiled":
            raise ImportError("PHCONTROL_KERNELS is 'compiled', but the kernels were not built") from error
        from phcontrol.mechanics import _lapack as _chosen
        from phcontrol.mechanics import _numpy_frames as _frames

KERNELS = _chosen.__name__.rpartition("._")[-1]
"""Which kernels are in use: "compiled" or "lapack"."""

factor = _chosen.factor
feedback = _chosen.feedback
finite_copy = _chosen.finite_copy
momentum_derivative = _chosen.momentum_derivative
relative_factor_rate = _chosen.relative_factor_rate
solve = _chosen.solve
solve_transposed = _chosen.solve_transposed
transformed_rate = _chosen.transformed_rate

curve_point = _frames.curve_point
damping_root = _frames.damping_root
frame_wrench = _frames.frame_wrench
hand_damping = _frames.hand_damping
right_inverse_motion = _frames.right_inverse_motion
modes = _numpy_frames.modes
task_space = _frames.task_space
without_task = _frames.without_task
