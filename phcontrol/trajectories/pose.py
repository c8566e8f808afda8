"""Poses as they come from outside."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array
from phcontrol.exceptions import InvalidArgumentError

Pose: TypeAlias = pin.SE3 | ArrayLike | tuple[ArrayLike, ArrayLike]
"""A pin.SE3, a 4 × 4 matrix, or a pair of a point and a rotation matrix; or a point alone, its orientation free [m]."""

_FORMS = "must be a point (3,), a pin.SE3, a 4 × 4 matrix or a pair of a point and a rotation matrix"


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
