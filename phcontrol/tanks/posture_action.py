"""A spring on the joints that leaves a frame alone."""

from __future__ import annotations

from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, gain, vector
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.tanks.action import Action


class PostureAction(Action):
    """a = −NᵀK_n(q − q_r) with N = 1 − M⁻¹𝒥ᵀΛ𝒥: the part of a spring that does not accelerate the frame.

    It has no potential, and by itself may put energy in without end. Towards a singularity, where no motion leaves the
    frame quite alone any more, it fades (``TaskSpace.clearance``).

    Args:
        system: the arm.
        frame: that is left alone.
        posture: q_r [rad].
        stiffness: K_n, scalar, vector or matrix, positive definite [N·m/rad].
        rows: 6 to leave the frame's pose alone, 3 its position.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, PostureAction, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> action = PostureAction(system, "tool", system.robot.home, stiffness=5.0)
        >>> x = system.at(system.robot.near_home())
        >>> acceleration = np.linalg.solve(x.mass_matrix, action.torque(0.0, x))
        >>> moved = x.frame_jacobian("tool", "local_world_aligned") @ acceleration
        >>> bool(np.abs(moved).max() < 1e-9), bool(np.abs(acceleration).max() > 0.1)  # the joints go, the hand stays
        (True, True)
    """

    def __init__(
        self, system: MechanicalSystem, frame: str, posture: ArrayLike, stiffness: ArrayLike, *, rows: int = 6
    ) -> None:
        system.frame_id(frame)
        self.frame, self.rows = frame, int(choice("rows", str(rows), ("3", "6")))
        self.posture = vector("posture", posture, system.n)
        self.stiffness = gain("stiffness", stiffness, system.n)

    def torque(self, t: float, x: MechanicalState) -> Array:
        """Return a = −c T P T⁻¹K_n(q − q_r), P and c of the frame's task space, shape (n,) [N·m]."""
        task = x.task_space(self.frame, self.rows)
        pull = task.without_task_force(self.stiffness.dot(x.position_error(self.posture)))
        pull *= -task.clearance
        return pull
