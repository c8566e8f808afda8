"""The kernels about a frame on NumPy: where no compiler was at hand, as their own check, and in symbols.

A traced law computes with them too: NumPy and LAPACK are then those of ``phcontrol.compilation.arithmetic``.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import lapack

from phcontrol._validation import Array

FREE = 1e-12  # of the largest squared frequency of a mode, below which it counts as that
_dgetrf, _dgetrs, _dpotrf, _dtrtrs, _dsyev = lapack.dgetrf, lapack.dgetrs, lapack.dpotrf, lapack.dtrtrs, lapack.dsyev
_NOTHING: Array = np.zeros(3)
_NOTHING.flags.writeable = False


def frame_wrench(
    r: Array, R: Array, goal_r: Array, goal_R: Array | None, stiffness: Array | None, force: Array | None,
    turning: Array | None,
) -> Array:  # fmt: skip
    """Return (K(r − r_d) + F, vee(B − Bᵀ)) with B = R_d M Rᵀ."""
    linear = _NOTHING if stiffness is None else stiffness.dot(r - goal_r)
    if force is not None:
        linear = linear + force
    if turning is None:
        return np.concatenate([linear, _NOTHING])
    turned = turning if goal_R is None else goal_R.dot(turning)
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = turned.dot(R.T).tolist()
    return np.concatenate([linear, [zy - yz, xz - zx, yx - xy]])


def task_space(jacobian: Array, factor: Array, weight_root: Array) -> tuple[Array, Array, Array, float]:
    """Return W = T⁻¹𝒥ᵀ, B = WᵀW, A = 𝒥𝒥ᵀ and (tr Y⁴)^½ of Y = HᵀA⁻¹H."""
    reduced, square = _dtrtrs(factor, jacobian.T, 1)[0], jacobian.dot(jacobian.T)
    root, info = _dpotrf(square, 1, 1)
    bound = math.inf
    if not info:
        columns = _dtrtrs(root, weight_root, 1)[0]
        inverse = columns.T.dot(columns)
        fourth = inverse.dot(inverse)
        bound = math.sqrt(np.vdot(fourth, fourth))
    return reduced, reduced.T.dot(reduced), square, bound


def modes(matrix: Array, doubt: float, otherwise: float) -> tuple[Array, Array]:
    """Return the eigenvalues of a symmetric matrix, in ascending order, and its eigenvectors, as columns.

    In a trace, and so in C, they are looked for only where ``doubt`` > 0; elsewhere they are ``otherwise``, and the
    vectors 0.
    """
    values, vectors, _ = _dsyev(matrix)
    return values, vectors


def without_task(jacobian: Array, factor: Array, reduced: Array, mobility: Array, force: Array) -> Array:
    """Return f − 𝒥ᵀB⁻¹WᵀT⁻¹f."""
    twist = _dtrtrs(factor, force, 1)[0].dot(reduced)
    rest: Array = force - _solved(mobility, twist).dot(jacobian)
    return rest


def hand_damping(
    jacobian: Array, root: Array, mobility: Array, mass_matrix: Array, velocity: Array, rate: float
) -> Array:
    """Return 𝒥ᵀ(XXᵀ − d B⁻¹)𝒥v + d M v."""
    twist = jacobian.dot(velocity)
    wrench = root.dot(twist.dot(root)) - rate * _solved(mobility, twist)
    force: Array = wrench.dot(jacobian) + rate * mass_matrix.dot(velocity)
    return force


def _solved(mobility: Array, twist: Array) -> Array:
    """Return B⁻¹ξ."""
    root, info = _dpotrf(mobility, 1, 1)
    if info:
        raise ArithmeticError("the matrix is not positive definite")
    solution: Array = _dtrtrs(root, _dtrtrs(root, twist, 1)[0], 1, 1)[0]
    return solution


def damping_root(linear: Array, turning: Array | None, R: Array | None, mobility: Array, ratio: float) -> Array:
    """Return X = (2ζ)^½ L U S^(−¼), with LᵀBL = U S Uᵀ."""
    root = linear
    if turning is not None:
        assert R is not None
        none = np.zeros((3, 3))
        root = np.concatenate([np.hstack([linear, none]), np.hstack([none, R.dot(turning)])])
    squares, modes, _ = _dsyev(root.T.dot(mobility).dot(root))
    result: Array = root.dot(modes)
    result *= math.sqrt(2.0 * ratio) / np.maximum(squares, FREE * squares[-1]) ** 0.25
    return result


def right_inverse_motion(
    matrix: Array, rate: Array, square: Array, square_rate: Array | None, desired: Array, desired_rate: Array
) -> tuple[Array, Array]:
    """Return s = BᵀA⁻¹w and ṡ along Ḃ, Ȧ and ẇ; NaN where A is singular."""
    lu, pivots, info = _dgetrf(square)
    if info:
        return np.full(matrix.shape[1], np.nan), np.full(matrix.shape[1], np.nan)
    y: Array = _dgetrs(lu, pivots, desired)[0]
    s = y.dot(matrix)
    lost = rate.dot(s) + matrix.dot(y.dot(rate)) if square_rate is None else square_rate.dot(y)
    y_rate: Array = _dgetrs(lu, pivots, desired_rate - lost)[0]
    return s, y.dot(rate) + y_rate.dot(matrix)


def curve_point(
    table: Array, rate: float, s: float, speed: float, acceleration: float,
    turned: tuple[Array, Array, Array, Array] | None,
) -> tuple[Array, Array | None, Array, Array]:  # fmt: skip
    """Return r, R, twist and its rate on a curve."""
    waves = range(1, len(table) // 2)
    once = [wave * rate for wave in waves]
    cosine, sine = [np.cos(k * s) for k in once], [np.sin(k * s) for k in once]
    rows: Array = np.array(
        [
            [1.0, s, *cosine, *sine],
            [0.0, 1.0, *(-k * value for k, value in zip(once, sine, strict=True)),
             *(k * value for k, value in zip(once, cosine, strict=True))],
            [0.0, 0.0, *(-k * k * value for k, value in zip(once * 2, cosine + sine, strict=True))],
        ]
    )  # fmt: skip
    value, slope, bend = rows.dot(table)
    motion, motion_rate = slope * speed, bend * (speed * speed) + slope * acceleration
    if turned is None:
        return value[:3], None, motion[:3], motion_rate[:3]
    still, across, back, axis = turned
    turn = still + np.sin(value[3]) * across + (1.0 - np.cos(value[3])) * back
    twist, twist_rate = (np.concatenate([along[:3], along[3] * axis]) for along in (motion, motion_rate))
    return value[:3], turn, twist, twist_rate
