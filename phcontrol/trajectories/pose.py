"""Poses as they come from outside."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, check_homogeneous, finite_array
from phcontrol.exceptions import InvalidArgumentError

Pose: TypeAlias = pin.SE3 | ArrayLike | tuple[ArrayLike, ArrayLike]
"""A pin.SE3, a 4 × 4 matrix, or a pair of a point and a rotation matrix; or a point alone, its orientation free [m]."""

_FORMS = "must be a point (3,), a pin.SE3, a 4 × 4 matrix or a pair of a point and a rotation matrix"

HALF_TURN_MARGIN = 1e-3
"""How near to half a turn the way round is not clear [rad]."""


def pose(name: str, value: Pose) -> tuple[Array, Array | None]:
    """Return a point, shape (3,) [m], and a rotation matrix, shape (3, 3), or None where the orientation is free."""
    if isinstance(value, pin.SE3):
        value = value.homogeneous
    if isinstance(value, (tuple, list)) and len(value) == 2:
        point, turn = finite_array(name, value[0]), finite_array(name, value[1])
        if point.shape != (3,) or turn.shape != (3, 3):
            raise InvalidArgumentError(name, f"{_FORMS}, but is a pair of shapes {point.shape} and {turn.shape}")
        return point, rotation(name, turn)
    array = finite_array(name, value)
    if array.shape == (3,):
        return array, None
    if array.shape != (4, 4):
        raise InvalidArgumentError(name, f"{_FORMS}, but has shape {array.shape}")
    check_homogeneous(name, array)
    return array[:3, 3], rotation(name, array[:3, :3])


def rotation(name: str, value: ArrayLike) -> Array:
    """Return the rotation matrix nearest to ``value``, shape (3, 3), which must be one to 10⁻⁶."""
    matrix = finite_array(name, value)
    if matrix.shape != (3, 3) or np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-6 or np.linalg.det(matrix) < 0.0:
        raise InvalidArgumentError(name, f"{_FORMS}, but its rotation is none:\n{matrix}")
    left, _, right = np.linalg.svd(matrix)
    result: Array = left @ right
    return result


def direction(name: str, value: ArrayLike) -> Array:
    """Return a vector of three numbers, not all zero, at length one."""
    array = finite_array(name, value)
    length = float(np.linalg.norm(array))
    if array.shape != (3,) or length == 0.0:
        raise InvalidArgumentError(name, f"must be a direction of three numbers, not all zero, but is {array}")
    result: Array = array / length
    return result


def shortest_turn(name: str, origin: Array, goal: Array) -> tuple[Array, float]:
    """Return the axis in the world and the angle of the shortest turn from one orientation to another [rad]."""
    between = rotation(name, goal @ origin.T)
    sine_axis = 0.5 * np.array(
        [between[2, 1] - between[1, 2], between[0, 2] - between[2, 0], between[1, 0] - between[0, 1]]
    )
    sine = float(np.linalg.norm(sine_axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(between) - 1.0)))
    if np.pi - angle < HALF_TURN_MARGIN:
        raise InvalidArgumentError(
            name, "is half a turn from the orientation before it, and which way round is not clear: put one between"
        )
    return (sine_axis / sine if sine > 0.0 else np.array([0.0, 0.0, 1.0])), angle
