"""A bound on how easily a joint is moved, for all postures at once."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.mechanics.system import MechanicalSystem

_POINTS = 720  # at which the joint's own angle is looked at
_SINGULAR = 1e-12  # of an inertia's largest eigenvalue


def least_inertia(system: MechanicalSystem) -> Array:
    """Return μ with 1/(M⁻¹)_ii ≥ μ_i in every posture, shape (n,) [kg·m²]; 0 where nothing is known.

    1/(M⁻¹)_ii is twice the least kinetic energy with which joint i moves at 1 rad/s while the other joints move as they
    like. Of all bodies only the two that it joins are counted, a and b, the inner one with any twist ξ that it can
    have (any at all, or a multiple of the first joint's axis where that alone carries it), and the joint's own rotor:

        1/(M⁻¹)_ii ≥ I_rotor + min over ξ of ξᵀI_aξ + (ξ + S)ᵀI_b(q_i)(ξ + S) =: I_rotor + f(q_i).

    f knows the joint's own position alone. Of the first joint the body after its own is counted too, less what the
    joint between them lets go. |d ln f/dq_i| ≤ 2‖ad_S‖ in the norm of I_b, by which what lies between the 720 positions
    that are looked at is bounded too: nothing is sampled. A prismatic joint is looked at between its limits.

    Args:
        system: the arm.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, load_robot
        >>> from phcontrol.mechanics.least_inertia import least_inertia
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> inverse = np.linalg.inv(system.at([0.3, -0.4]).mass_matrix)
        >>> bool((least_inertia(system) <= 1.0 / inverse.diagonal()).all())
        True
    """
    robot, model = system.robot, system.model
    own = np.array([_of_joint(system, joint) for joint in range(1, model.njoints)])
    own += np.asarray(model.armature, dtype=float)
    if robot.coupling is None:
        return own
    found = np.zeros(system.n)
    for row, value in zip(robot.coupling.matrix, own, strict=True):
        moved = np.flatnonzero(row)
        if moved.size == 1:  # moved by one independent joint, which need not be of the same size
            found[moved[0]] = max(found[moved[0]], row[moved[0]] ** 2 * value)
    return found


def _of_joint(system: MechanicalSystem, joint: int) -> float:
    """Return the least f of one joint of the model."""
    model = system.model
    outer, parent = np.array(model.inertias[joint].matrix()), int(model.parents[joint])
    axis = _axis(model, joint)
    if parent == 0:
        return float(axis @ outer @ axis) + sum(_carried(system, child, axis) for child in _children(model, joint))
    values = np.linalg.eigvalsh(outer)
    if not values[0] > _SINGULAR * values[-1]:
        return 0.0
    place = model.jointPlacements[joint]
    inner = np.array(place.actInv(model.inertias[parent]).matrix())
    free: Array = np.eye(6)
    if int(model.parents[parent]) == 0:
        free = np.array(place.actInv(pin.Motion(_axis(model, parent))).vector)[:, None]
    slope = _slope(np.linalg.cholesky(outer), axis)
    first, last = _range(system, joint)
    if not math.isfinite(last - first):
        return 0.0
    grid = np.linspace(first, last, _POINTS + 1)
    half = 0.5 * (last - first) / _POINTS
    found = math.inf
    for position in grid:
        moved = pin.exp6(pin.Motion(position * axis)).act(model.inertias[joint]).matrix()
        together = free.T @ (inner + moved) @ free
        pull = free.T @ moved @ axis
        found = min(found, float(axis @ moved @ axis - pull @ np.linalg.solve(together, pull)))
    return max(found, 0.0) * math.exp(-slope * half)


def _carried(system: MechanicalSystem, joint: int, motion: Array) -> float:
    """Return what the next body adds to the first joint's inertia at the least, its own joint moving as it likes."""
    model = system.model
    axis, place = _axis(model, joint), model.jointPlacements[joint]
    inertia = np.array(model.inertias[joint].matrix())
    pull = inertia @ axis
    own = float(axis @ pull) + float(model.armature[model.joints[joint].idx_v])
    first, last = _range(system, joint)
    if not own > 0.0 or not math.isfinite(last - first):
        return 0.0
    left = inertia - np.outer(pull, pull) / own
    seen = np.array(place.actInv(pin.Motion(motion)).vector)
    values, vectors = np.linalg.eigh(left)
    kept = values > _SINGULAR * values[-1]
    if not kept.any():
        return 0.0
    found = math.inf
    for position in np.linspace(first, last, _POINTS + 1):
        turned = np.array(pin.exp6(pin.Motion(position * axis)).actInv(pin.Motion(seen)).vector)
        found = min(found, float(turned @ left @ turned))
    slope = _slope(vectors[:, kept] * np.sqrt(values[kept]), axis)
    return max(found, 0.0) * math.exp(-slope * 0.5 * (last - first) / _POINTS)


def _slope(factor: Array, axis: Array) -> float:
    """Return 2‖ad_S‖ in the norm of an inertia L Lᵀ, shape (6, k) of L: by how much its logarithm can change."""
    turning = np.array(pin.Motion(axis).action)
    return 2.0 * float(np.linalg.norm(factor.T @ turning @ np.linalg.pinv(factor.T), 2))


def _children(model: pin.Model, joint: int) -> list[int]:
    return [each for each in range(1, model.njoints) if int(model.parents[each]) == joint]


def _axis(model: pin.Model, joint: int) -> Array:
    """Return the joint's motion subspace S at any position, (linear, angular), shape (6,)."""
    kind = model.joints[joint]
    data = kind.createData()
    kind.calc(data, pin.neutral(model))
    subspace: Array = np.asarray(data.S, dtype=float).reshape(6)
    return subspace


def _range(system: MechanicalSystem, joint: int) -> tuple[float, float]:
    """Return between which positions a joint of the model is looked at: one turn, or a prismatic joint's limits."""
    if _axis(system.model, joint)[3:].any():
        return -math.pi, math.pi
    index = system.model.joints[joint].idx_q
    robot = system.robot
    if robot.coupling is None:
        return float(robot.lower[index]), float(robot.upper[index])
    row = robot.coupling.matrix[index]
    ends = np.array([row * robot.lower, row * robot.upper])
    ends = np.where(row == 0.0, 0.0, ends)
    offset = float(robot.coupling.offset[index])
    return float(ends.min(axis=0).sum()) + offset, float(ends.max(axis=0).sum()) + offset
