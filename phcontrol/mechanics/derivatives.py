"""Analytic derivatives with respect to the configuration: pure functions of arrays and a Pinocchio model.

In every tensor the first index is the joint k that the derivative is taken with respect to.
Pinocchio 4.1's own kinematic Hessians come back from Python with scrambled strides; they are not used.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from phcontrol._validation import Array


def lower_half(matrix: Array) -> Array:
    """Return Φ(X): the lower triangle of X (or of each X in a stack) with its diagonal halved."""
    result: Array = np.tril(matrix)
    diagonal = np.arange(matrix.shape[-1])
    result[..., diagonal, diagonal] *= 0.5
    return result


def mass_matrix_derivative(model: pin.Model, data: pin.Data, position: Array) -> Array:
    """Return ∂M/∂q, shape (n, n, n): [k] is ∂M/∂q_k = C(q, e_k) + C(q, e_k)ᵀ.

    Holds because Pinocchio's Coriolis matrix is that of the Christoffel symbols, and linear in q̇.
    """
    size = model.nv
    result: Array = np.empty((size, size, size))
    unit = np.zeros(size)
    for k in range(size):
        unit[k] = 1.0
        coriolis = pin.computeCoriolisMatrix(model, data, position, unit)
        np.add(coriolis, coriolis.T, out=result[k])
        unit[k] = 0.0
    return result


def factor_derivative(factor: Array, mass_matrix_derivative: Array) -> Array:
    """Return ∂T/∂q, shape (n, n, n): [k] is ∂T/∂q_k = T Φ(T⁻¹ (∂M/∂q_k) T⁻ᵀ), lower triangular.

    Args:
        factor: T, lower triangular, M = T Tᵀ.
        mass_matrix_derivative: ∂M/∂q as of :func:`mass_matrix_derivative` (or Ṁ alone, shape (n, n),
            which gives Ṫ).
    """
    inverse = lapack.dtrtri(factor, lower=1)[0]
    result: Array = factor @ lower_half(inverse @ mass_matrix_derivative @ inverse.T)
    return result


def frame_jacobian_rate(
    model: pin.Model,
    data: pin.Data,
    position: Array,
    velocity: Array,
    frame_id: int,
    reference: pin.ReferenceFrame,
) -> Array:
    """Return 𝒥̇ along a velocity, shape (6, n), rows (linear, angular)."""
    return frame_jacobian_and_rate(model, data, position, velocity, frame_id, reference)[1]


def frame_jacobian_and_rate(
    model: pin.Model,
    data: pin.Data,
    position: Array,
    velocity: Array,
    frame_id: int,
    reference: pin.ReferenceFrame,
) -> tuple[Array, Array]:
    """Return 𝒥 and 𝒥̇ along a velocity in one pass, shape (6, n) each, rows (linear, angular)."""
    pin.computeJointJacobiansTimeVariation(model, data, position, velocity)
    pin.updateFramePlacement(model, data, frame_id)
    jacobian: Array = pin.getFrameJacobian(model, data, frame_id, reference)
    rate: Array = pin.getFrameJacobianTimeVariation(model, data, frame_id, reference)
    return jacobian, rate


def frame_jacobian_derivative(
    model: pin.Model, data: pin.Data, position: Array, frame_id: int, reference: pin.ReferenceFrame
) -> Array:
    """Return ∂𝒥/∂q, shape (n, 6, n), rows (linear, angular) [per rad]: [k] is ∂𝒥/∂q_k.

    With 𝒥_i the twist of joint i in the frame's own axes, ∂𝒥_i/∂q_k = 𝒥_i × 𝒥_k (the motion cross
    product) for k behind i on the chain to the frame, else 0. In the world's frame it is
    𝒥_k × 𝒥_i for k before i. With the frame's origin and the world's axes the local columns are
    turned, and the turning itself differentiated. Joints of one degree of freedom each.
    """
    local = pin.ReferenceFrame.LOCAL
    world = reference == pin.ReferenceFrame.WORLD
    pin.computeJointJacobians(model, data, position)
    pin.updateFramePlacement(model, data, frame_id)
    jacobian = pin.getFrameJacobian(model, data, frame_id, reference if world else local)
    # columns of joints off the chain are zero, and along it the index grows: "behind" is a greater index
    products = motion_cross_products(jacobian)
    later = _later(model.nv)
    result: Array = -products * later.T if world else products * later
    if reference == pin.ReferenceFrame.LOCAL_WORLD_ALIGNED:
        rotation = data.oMf[frame_id].rotation
        turned = np.concatenate([rotation @ jacobian[:3], rotation @ jacobian[3:]])
        turns = cross_matrices(turned[3:])
        result[:, :3] = rotation @ result[:, :3] + turns @ turned[:3]
        result[:, 3:] = rotation @ result[:, 3:] + turns @ turned[3:]
    return result


@cache
def _later(size: int) -> Array:
    """Return a mask, shape (n, 1, n): [k, 0, i] is 1 for k > i, else 0."""
    mask: Array = np.tri(size, k=-1)[:, None, :]
    mask.flags.writeable = False
    return mask


def motion_cross_products(twists: Array) -> Array:
    """Return the motion cross products of the columns of a (6, n) matrix: [k, :, i] = column i × column k."""
    linear, angular = twists[:3], twists[3:]
    turns = cross_matrices(angular)
    result: Array = np.empty((twists.shape[1], *twists.shape))
    np.matmul(turns, linear, out=result[:, :3])
    result[:, :3] += cross_matrices(linear) @ angular
    np.matmul(turns, angular, out=result[:, 3:])
    np.negative(result, out=result)  # a × b = −(b × a)
    return result


def cross_matrices(vectors: Array) -> Array:
    """Return for each column w of a (3, n) matrix the matrix of w × ·, shape (n, 3, 3)."""
    x, y, z = vectors
    result: Array = np.zeros((vectors.shape[1], 3, 3))
    result[:, 0, 1], result[:, 0, 2], result[:, 1, 2] = -z, y, -x
    result[:, 1, 0], result[:, 2, 0], result[:, 2, 1] = z, -y, x
    return result


def right_inverse(matrix: Array, regularisation: Array | None = None) -> Array:
    """Return B† = Bᵀ(BBᵀ + Q)⁻¹, shape (n, m), of a wide (m, n) matrix B (5.23).

    Args:
        matrix: B, of full row rank unless Q makes up for it.
        regularisation: Q, shape (m, m); None for zero, so that B B† = 1.

    All NaN where BBᵀ + Q is singular.
    """
    square = matrix @ matrix.T if regularisation is None else matrix @ matrix.T + regularisation
    try:
        result: Array = np.linalg.solve(square.T, matrix).T
    except np.linalg.LinAlgError:
        result = np.full_like(matrix.T, np.nan)
    return result


def right_inverse_derivative(
    matrix: Array,
    derivative: Array,
    regularisation: Array | None = None,
    regularisation_derivative: Array | None = None,
) -> Array:
    """Return dB† for a change dB of B, or for each of a stack of them, shape (..., n, m).

        dB† = dBᵀA⁻¹ − B†(dB Bᵀ + B dBᵀ + dQ)A⁻¹,   A = BBᵀ + Q,

    which for Q = 0 is −B†dB B† + (1 − B†B)dBᵀ(BBᵀ)⁻¹. All NaN where A is singular.
    """
    square = matrix @ matrix.T if regularisation is None else matrix @ matrix.T + regularisation
    try:
        inverse = np.linalg.inv(square)
    except np.linalg.LinAlgError:
        inverse = np.full_like(square, np.nan)
    half = derivative @ matrix.T
    change = half + np.swapaxes(half, -1, -2)
    if regularisation_derivative is not None:
        change = change + regularisation_derivative
    result: Array = (np.swapaxes(derivative, -1, -2) - matrix.T @ inverse @ change) @ inverse
    return result


def transformed_velocity_derivative(
    factor: Array, factor_derivative: Array, velocity: Array, velocity_derivative: Array
) -> Array:
    """Return ∂θ/∂q of θ = Tᵀs(q), shape (n, n): column k is (∂T/∂q_k)ᵀs + Tᵀ∂s/∂q_k.

    Args:
        factor: T.
        factor_derivative: ∂T/∂q as of :func:`factor_derivative`.
        velocity: s, shape (n,).
        velocity_derivative: ∂s/∂q, shape (n, n), column k for q_k.
    """
    result: Array = (velocity @ factor_derivative).T + factor.T @ velocity_derivative
    return result
