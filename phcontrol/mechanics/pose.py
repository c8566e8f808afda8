"""Where a frame is and how it is turned, and how both move with the joints."""

from __future__ import annotations

from typing import Any, NamedTuple

import pinocchio as pin

from phcontrol._validation import Array, check_homogeneous, finite_array, rotation, vector
from phcontrol.exceptions import InvalidArgumentError


class Pose(NamedTuple):
    """The pose of a frame in the world. Wherever one is taken, ``pin.SE3`` does as well.

    >>> import numpy as np
    >>> from phcontrol import Pose
    >>> Pose(np.array([0.4, 0.0, 0.3]), np.eye(3)).translation
    array([0.4, 0. , 0.3])
    """

    translation: Array
    """r, the origin of the frame in the world, shape (3,) [m]."""
    rotation: Array
    """R, shape (3, 3): its columns are the axes of the frame in the world."""


class FrameKinematics(NamedTuple):
    """Pose and Jacobian of a frame, of one pass of kinematics."""

    translation: Array
    """r, shape (3,) [m]."""
    rotation: Array
    """R, shape (3, 3)."""
    jacobian: Array
    """𝒥, shape (6, n), rows (linear, angular), at the frame's origin in the axes of the world: (ṙ, ω) = 𝒥 q̇."""


def check_pose(name: str, value: Any) -> Pose:
    """Return a pose from a ``Pose``, a pin.SE3 or a (4, 4) homogeneous matrix; arrays are copied, read-only.

    Raises InvalidArgumentError, naming ``name``, when it is none, is not finite or its rotation is no rotation.
    """
    if isinstance(value, (Pose, pin.SE3)):
        translation, turn = value.translation, value.rotation
    else:
        array = finite_array(name, value)
        if array.shape != (4, 4):
            message = f"must be a pose (Pose, pin.SE3 or a (4, 4) matrix), but has shape {array.shape}"
            raise InvalidArgumentError(name, message)
        check_homogeneous(name, array)
        translation, turn = array[:3, 3], array[:3, :3]
    return Pose(vector(f"{name}.translation", translation, 3), rotation(f"{name}.rotation", turn))
