"""A force and a torque on a frame, as far as they have a potential."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, rotation, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.pose import Pose
from phcontrol.mechanics.state import MechanicalState
from phcontrol.potentials.frame_potential import FramePotential, skew


class FrameWrench(FramePotential):
    """A constant force F on the origin of a frame, and a torque that is τ at one orientation R_d.

        Ψ = Fᵀ(r − r_d) + ½⟨[R_dᵀτ]×, R_e⟩,   R_e = R_dᵀR;   its torque is ½(tr(Q)1 − Qᵀ)τ with Q = R R_dᵀ

    **A constant torque has no potential**: its work over a full turn about its own axis is 2π|τ|, and turns about
    different axes do not commute, so that its work depends on the way even for small turns. This is what is linear in
    R and has the torque τ at R = R_d. Turned by φ about τ it is τ cos φ, and the energy |τ| sin φ; turned by φ about an
    axis across τ it is ½(1 + cos φ)τ along τ, and ½|τ| sin φ across both. A law that shapes it rests where the
    environment answers with that wrench. No minimum is counted (|τ| sin φ has one, a quarter turn away).

    The coordinates are r − r_d and the nine entries of R_e. A goal that moves takes the torque along: then R_dᵀτ, the
    torque in the goal's own axes, is constant.

    Args:
        frame: name of a link or frame.
        force: the wrench (F, τ), at the frame's origin in the axes of the world, shape (6,) [N, N·m].
        orientation: R_d, shape (3, 3), the axes of the frame in the world at which the torque is τ.

    Raises:
        InvalidArgumentError: not six finite numbers, a torque without an orientation, or no rotation.

    Example:
        >>> import numpy as np
        >>> from phcontrol import FrameWrench, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.home)
        >>> wrench = FrameWrench("tool", [0, 0, 10, 1, 0, 0], orientation=x.placement("tool").rotation)
        >>> np.allclose(wrench.gradient(x), x.frame_jacobian("tool", "local_world_aligned").T @ wrench.force)
        True
    """

    def __init__(self, frame: str, force: ArrayLike, *, orientation: ArrayLike | None = None) -> None:
        self.force = vector("force", force, 6)
        """(F, τ), shape (6,) [N, N·m]."""
        torque = self.force[3:]
        if orientation is None and torque.any():
            raise InvalidArgumentError(
                "orientation",
                "must be given with a torque, which has no potential on its own: the rotation at which it is meant",
            )
        turn = np.eye(3) if orientation is None else rotation("orientation", orientation)
        turning = 0.5 * skew(turn.T @ torque)
        super().__init__(frame, Pose(np.zeros(3), turn), force=self.force[:3], turning=turning)

    def lever(self, x: MechanicalState) -> Array:
        """Return how ``force`` acts on the joints, shape (n, 6): ∂Ψ/∂q = lever · force."""
        kinematics = x.frame_kinematics(self.frame)
        lever: Array = kinematics.jacobian.T.copy()
        turn = kinematics.rotation @ self.goal.rotation.T
        lever[:, 3:] = lever[:, 3:] @ (0.5 * (np.trace(turn) * np.eye(3) - turn.T))
        return lever
