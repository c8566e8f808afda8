"""Where a camera is in a hand, from looks at a marker at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from phcontrol._validation import Array, finite_array, is_rotation, positive
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.pose import Pose

LEAST_SPREAD = 0.15
"""How much the hand must turn about at least two directions, as a root mean square over pairs of poses [rad]."""
_ROTATION_TOLERANCE = 1e-6  # of what counts as a rotation: what six printed digits leave
_FEWEST = 4


@dataclass(frozen=True)
class HandEyeCalibration:
    """Where the camera is in the hand, and how well the poses agree on that.

    Example:
        >>> import numpy as np
        >>> import pinocchio as pin
        >>> from phcontrol import calibrate_hand_eye
        >>> turns = [0.4 * (1 + k) * np.eye(3)[k % 3] for k in range(5)]
        >>> hand = [pin.SE3(pin.exp3(turn), np.array([0.1, 0.0, 0.3])) for turn in turns]
        >>> camera = pin.SE3(pin.exp3(np.array([0.2, -0.1, 1.5])), np.array([0.04, -0.06, 0.02]))
        >>> world = pin.SE3(np.eye(3), np.array([0.5, 0.1, 0.0]))
        >>> found = calibrate_hand_eye(hand, [(pose * camera).inverse() * world for pose in hand])
        >>> found.camera.translation.round(6), found.translation_residual < 1e-9
        (array([ 0.04, -0.06,  0.02]), True)
    """

    camera: pin.SE3
    """The camera in the hand's frame [m]."""
    marker: pin.SE3
    """The marker in the world [m]."""
    rotation_residual: float
    """How far off a pose sees the marker turned, root mean square [rad]."""
    translation_residual: float
    """How far off it sees it moved, root mean square [m]."""
    rotation_error: float
    """Standard error of the camera's rotation, of its worst direction [rad]."""
    translation_error: float
    """Standard error of the camera's place, of its worst direction [m]."""

    def __str__(self) -> str:
        place = np.array2string(1e3 * self.camera.translation, precision=2)
        return (
            f"camera at {place} mm in the hand, within {1e3 * self.translation_error:.2f} mm and "
            f"{math.degrees(self.rotation_error):.3f} degrees; poses agree to {1e3 * self.translation_residual:.2f} mm "
            f"and {math.degrees(self.rotation_residual):.3f} degrees"
        )


def calibrate_hand_eye(
    hands: Sequence[pin.SE3 | ArrayLike],
    markers: Sequence[pin.SE3 | ArrayLike],
    *,
    largest_rotation: float = math.radians(5.0),
    largest_translation: float = 0.01,
) -> HandEyeCalibration:
    """Return where a camera is in a hand, from poses of the hand and of a marker at rest that it sees.

    With H_i the hand in the world, M_i the marker in the camera, X the camera in the hand and W the marker in the
    world, H_i X M_i = W for all i. X begins with the closed form of F. C. Park and B. J. Martin, "Robot sensor
    calibration: solving AX = XB on the Euclidean group", IEEE Transactions on Robotics and Automation 10, 1994, from
    all pairs of poses (what OpenCV's ``calibrateHandEye`` calls PARK); then X and W make the sum of squares of
    log(W⁻¹H_i X M_i) smallest, rotations and translations weighed by how well they agree.

    Raises InvalidArgumentError for poses that are none, and for degenerate motions: the hand must turn about at least
    two directions, or where the camera is along the one cannot be told. Raises PHControlError where the poses do not
    agree: a marker that moved, a transform given the wrong way round, a lens whose distortion was not given.

    Args:
        hands: poses of the hand's frame in the world, each a pose or a (4, 4) matrix [m]; at least four.
        markers: poses of the marker in the camera's frame, as ``MarkerDetector.pose`` returns them, likewise.
        largest_rotation: that a pose may be off from the others, root mean square [rad].
        largest_translation: likewise [m].

    Example:
        >>> import numpy as np
        >>> import pinocchio as pin
        >>> from phcontrol import calibrate_hand_eye
        >>> turns = [[0.3, 0.0, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.5], [0.3, 0.3, 0.0], [-0.2, 0.1, 0.3]]
        >>> hands = [pin.SE3(pin.exp3(np.array(turn)), np.array([0.3, 0.0, 0.4])) for turn in turns]
        >>> camera = pin.SE3(np.eye(3), np.array([0.04, -0.06, 0.02]))
        >>> world = pin.SE3(np.eye(3), np.array([0.5, 0.1, 0.0]))
        >>> seen = [(hand * camera).inverse() * world for hand in hands]  # the marker, in the camera
        >>> found = calibrate_hand_eye(hands, seen)
        >>> found.camera.translation.round(6)
        array([ 0.04, -0.06,  0.02])
    """
    positive("largest_rotation", largest_rotation)
    positive("largest_translation", largest_translation)
    H, M = (_poses(name, poses) for name, poses in (("hands", hands), ("markers", markers)))
    if len(H) != len(M):
        raise InvalidArgumentError("markers", f"must be as many as hands, {len(H)}, but are {len(M)}")
    if len(H) < _FEWEST:
        raise InvalidArgumentError("hands", f"must hold at least {_FEWEST} poses, but has {len(H)}")
    start = _closed_form(H, M)
    residuals, covariance, camera, marker = _refined(H, M, start)
    moved, turned = (float(np.sqrt((residuals[:, part] ** 2).sum(axis=1).mean())) for part in (slice(3), slice(3, 6)))
    result = HandEyeCalibration(
        camera,
        marker,
        turned,
        moved,
        math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[3:6, 3:6])[-1]))),
        math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:3, :3])[-1]))),
    )
    if turned > largest_rotation or moved > largest_translation:
        raise PHControlError(
            f"the poses do not agree on where the camera is: the marker is seen {1e3 * moved:.3g} mm and "
            f"{math.degrees(turned):.3g} degrees off, allowed are {1e3 * largest_translation:g} mm and "
            f"{math.degrees(largest_rotation):g} degrees. Did the marker move, is a transform the wrong way round, or "
            "is the lens's distortion missing?"
        )
    return result


def _poses(name: str, poses: Any) -> list[pin.SE3]:
    if isinstance(poses, (str, bytes, pin.SE3)) or not hasattr(poses, "__iter__"):
        raise InvalidArgumentError(name, f"must be a sequence of poses, but is {type(poses).__name__}")
    return [_pose(name, number, pose) for number, pose in enumerate(poses)]


def _pose(name: str, number: int, pose: Any) -> pin.SE3:
    if isinstance(pose, (Pose, pin.SE3)):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = finite_array(name, pose.rotation), finite_array(name, pose.translation)
    else:
        matrix = finite_array(name, pose)
    if matrix.shape != (4, 4) or np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > _ROTATION_TOLERANCE:
        raise InvalidArgumentError(name, f"pose {number} must be a pose or a (4, 4) matrix with last row 0, 0, 0, 1")
    rotation = matrix[:3, :3]
    if not is_rotation(rotation, _ROTATION_TOLERANCE):
        raise InvalidArgumentError(
            name, f"pose {number} must have a rotation, R Rᵀ = 1 and det R = 1: {rotation.tolist()}"
        )
    left, _, right = np.linalg.svd(rotation)
    return pin.SE3(left @ right, np.array(matrix[:3, 3]))


def _closed_form(hands: list[pin.SE3], markers: list[pin.SE3]) -> pin.SE3:
    """Return X of A X = X B for the motions A of the hand and B of the camera between all pairs of poses."""
    pairs = list(combinations(range(len(hands)), 2))
    A = [hands[j].actInv(hands[i]) for i, j in pairs]
    B = [markers[j] * markers[i].inverse() for i, j in pairs]
    alpha, beta = (np.array([pin.log3(motion.rotation) for motion in motions]) for motions in (A, B))
    spread = np.sqrt(np.linalg.eigvalsh(alpha.T @ alpha / len(pairs)))
    if spread[1] < LEAST_SPREAD:
        raise InvalidArgumentError(
            "hands",
            f"must turn about at least two directions, by {LEAST_SPREAD:g} rad or more, but turn by {spread[2]:.2g} "
            f"rad about one and {spread[1]:.2g} rad about another: tilt the hand both ways",
        )
    left, _, right = np.linalg.svd(alpha.T @ beta)
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    slopes = np.concatenate([motion.rotation - np.eye(3) for motion in A])
    values = np.concatenate([rotation @ b.translation - a.translation for a, b in zip(A, B, strict=True)])
    return pin.SE3(rotation, np.linalg.lstsq(slopes, values, rcond=None)[0])


def _refined(hands: list[pin.SE3], markers: list[pin.SE3], start: pin.SE3) -> tuple[Array, Array, pin.SE3, pin.SE3]:
    """Return residuals (N, 6), the covariance of X and W (12, 12), X and W."""
    camera, marker = start, hands[0] * start * markers[0]
    weights = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])  # a first guess: a metre as ten radians
    residuals: Array = np.zeros((0, 6))
    covariance: Array = np.zeros((12, 12))

    for _ in range(3):
        X, W, scales = camera, marker, weights

        def off(step: Array, X: pin.SE3 = X, W: pin.SE3 = W) -> Array:
            left, right = (W * pin.exp6(step[6:])).inverse(), X * pin.exp6(step[:6])
            return np.array([pin.log6(left * H * right * M).vector for H, M in zip(hands, markers, strict=True)])

        def weighed(step: Array, off: Any = off, scales: Array = scales) -> Array:
            return np.ravel(off(step) * scales)

        found = least_squares(weighed, np.zeros(12), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        camera, marker = X * pin.exp6(found.x[:6]), W * pin.exp6(found.x[6:])
        residuals = off(found.x)
        freedom = max(1, residuals.size - 12)
        scale = float((found.fun**2).sum()) / freedom
        covariance = scale * np.linalg.pinv(found.jac.T @ found.jac)
        spread = [max(1e-9, float(np.sqrt((residuals[:, part] ** 2).mean()))) for part in (slice(3), slice(3, 6))]
        weights = np.repeat([1.0, spread[0] / spread[1]], 3)
    return residuals, covariance, camera, marker
