"""Analytic derivatives with respect to the configuration: pure functions of arrays and a Pinocchio model.

In every tensor the first index is the joint k that the derivative is taken with respect to.
Pinocchio 4.1's own kinematic Hessians come back from Python with scrambled strides; they are not used.
"""

from __future__ import annotations

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
    pin.computeJointJacobiansTimeVariation(model, data, position, velocity)
    pin.updateFramePlacement(model, data, frame_id)
    rate: Array = pin.getFrameJacobianTimeVariation(model, data, frame_id, reference)
    return rate


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
    chain = [model.joints[joint].idx_v for joint in model.supports[model.frames[frame_id].parentJoint] if joint]
    result: Array = np.zeros((model.nv, 6, model.nv))
    for place, i in enumerate(chain):
        for k in chain[:place] if world else chain[place + 1 :]:
            first, second = (k, i) if world else (i, k)
            result[k, :, i] = motion_cross(jacobian[:, first], jacobian[:, second])
    if reference == pin.ReferenceFrame.LOCAL_WORLD_ALIGNED:
        rotation = data.oMf[frame_id].rotation
        turned = np.vstack([rotation @ jacobian[:3], rotation @ jacobian[3:]])
        for k in chain:
            result[k, :3] = rotation @ result[k, :3]
            result[k, 3:] = rotation @ result[k, 3:]
            turn = pin.skew(turned[3:, k])
            result[k, :3] += turn @ turned[:3]
            result[k, 3:] += turn @ turned[3:]
    return result


def motion_cross(first: Array, second: Array) -> Array:
    """Return the motion cross product a × b of two twists (linear, angular)."""
    linear_first, angular_first = first[:3], first[3:]
    result: Array = np.empty(6)
    result[:3] = np.cross(angular_first, second[:3]) + np.cross(linear_first, second[3:])
    result[3:] = np.cross(angular_first, second[3:])
    return result
