"""What splines through poses and sampled paths share: polynomials for the position and for the quaternion."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.trajectories.frame_path import FrameReference, frame_name
from phcontrol.trajectories.piecewise import PiecewisePolynomial
from phcontrol.trajectories.pose import HALF_TURN_MARGIN

_SHORTEST = 0.5
"""How near to zero a quaternion's polynomial may come; the rotation turns fast where it is short."""


class InterpolatedPath:
    """The path of a frame from polynomials r_d(t) and c(t), R_d the rotation of the unit quaternion c/|c|.

        ω_d = 2 vec(ċ c*)/|c|²,   ω̇_d = (2 vec(c̈ c*) − 2 (c·ċ) ω_d)/|c|²

    in the axes of the world (c* is the conjugate). It is as smooth as the polynomials, passes what c passes, is at rest
    where they are, and does not depend on the axes that the rotations are written in, for interpolation is linear and
    multiplying by a quaternion turns the space of quaternions.

    Args:
        frame: name of the link or frame that moves.
        motion: of r_d (3), or of r_d and c = (x, y, z, w) (7).
        duration: when it has ended, or its period, where that is not the motion's own [s].
    """

    def __init__(self, frame: str, motion: PiecewisePolynomial, duration: float | None = None) -> None:
        self.frame = frame_name(frame)
        self.motion = motion
        self.duration = motion.duration if duration is None else duration
        if motion.n == 7:
            self._check_length()

    def at(self, t: float) -> FrameReference:
        """Return pose, twist and acceleration at time t [s]."""
        value, rate, second = self.motion.at(t)
        if len(value) == 3:
            return FrameReference(value, None, rate, second)
        x, y, z, w = value[3:].tolist()
        scale = 2.0 / (x * x + y * y + z * z + w * w)
        turn: Array = np.array(
            [
                [1.0 - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)],
                [scale * (x * y + w * z), 1.0 - scale * (x * x + z * z), scale * (y * z - w * x)],
                [scale * (x * z - w * y), scale * (y * z + w * x), 1.0 - scale * (x * x + y * y)],
            ]
        )
        # 2 vec(ċ c*)/|c|² of ċ is a linear map
        spread = scale * np.array([[w, -z, y, -x], [z, w, -x, -y], [-y, x, w, -z]])
        spin = spread.dot(rate[3:])
        spin_rate = spread.dot(second[3:]) - scale * float(value[3:].dot(rate[3:])) * spin
        return FrameReference(
            value[:3], turn, np.concatenate([rate[:3], spin]), np.concatenate([second[:3], spin_rate])
        )

    def _check_length(self) -> None:
        """Raise InvalidArgumentError where c comes so near to zero that the rotation between would be wild."""
        for t in np.linspace(self.motion.start, self.motion.end, 20 * self.motion.pieces + 400):
            if np.linalg.norm(self.motion.at(float(t)).position[3:]) < _SHORTEST:
                raise InvalidArgumentError(
                    "rotations", f"turn too far between two poses near {t:.3g} s: put some between, or take more time"
                )


def quaternions(name: str, rotations: list[Array]) -> Array:
    """Return unit quaternions (x, y, z, w), shape (m, 4), each of the sign nearer to the one before.

    Raises InvalidArgumentError where a turn between two is half a turn, for which way round is then not clear.
    """
    result = np.array([pin.Quaternion(np.array(turn)).coeffs() for turn in rotations])
    for k in range(1, len(result)):
        cosine = float(result[k - 1].dot(result[k]))  # of half the angle
        if abs(cosine) < np.sin(0.5 * HALF_TURN_MARGIN):
            raise InvalidArgumentError(
                name, f"must not be half a turn apart, as number {k - 1} and {k} are: which way round is not clear"
            )
        result[k] *= np.sign(cosine)
    return result
