"""A spring on the pose of a frame."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, direction, finite_array, gain
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.pose import Pose, check_pose
from phcontrol.potentials.frame_potential import FramePotential


class FrameSpring(FramePotential):
    """A spring between the pose (r, R) of a frame and a goal (r_d, R_d), smooth everywhere.

        Ψ = ½eᵀK_t e + tr(G(1 − R_e)),   e = r − r_d,  R_e = R_dᵀR,  G = ½tr(K_r)1 − K_r

    Its wrench is (K_t e, R vee(G R_e − R_eᵀG)), at the frame's origin in the axes of the world. Near the goal its
    torque is K_r times the angle of rotation; it is bounded, and zero again only at half turns about the principal axes
    of K_r, where Ψ is not least. With a logarithm or Euler angles it would jump there. E. Fasse and J. Broenink, "A
    spatial impedance controller for robotic manipulation", IEEE Transactions on Robotics and Automation 13(1), 1997.

    The coordinates are e and the nine entries of R_e, as far as there is a stiffness. On an arm with more joints than
    directions held it leaves motions of the arm free: see ``lacks_minimum``; add a ``SingleJointSpring`` for an elbow.

    Args:
        frame: name of a link or frame.
        goal: the pose (r_d, R_d) in the world: ``Pose``, pin.SE3 or (4, 4) matrix; without a rotational stiffness a
            point r_d of three coordinates [m] does.
        translational_stiffness: K_t, scalar, vector or matrix, positive definite, in the axes of the world [N/m]; None
            or 0 leaves the position out.
        rotational_stiffness: K_r at the goal, likewise, in the axes of the goal [N·m/rad]; None or 0 leaves the
            orientation out.
        free_direction: a direction n in the world along which nothing holds: K_t acts across it, P K_t P with
            P = 1 − n nᵀ.

    Raises:
        InvalidArgumentError: a stiffness is not positive definite, the goal is no pose, or nothing is held.

    Example:
        >>> from phcontrol import FrameSpring, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> goal = system.at(system.robot.home).placement("tool")
        >>> spring = FrameSpring("tool", goal, translational_stiffness=300.0, rotational_stiffness=[8.0, 8.0, 4.0])
        >>> spring.energy(system.at(system.robot.home + 0.01)) < 0.5 * 300.0 * 0.02**2
        True
        >>> spring.lacks_minimum(system)
        "FrameSpring('tool') holds 6 of the 7 directions in which the joints move, and no others"
    """

    def __init__(
        self,
        frame: str,
        goal: Any,
        *,
        translational_stiffness: ArrayLike | None = None,
        rotational_stiffness: ArrayLike | None = None,
        free_direction: ArrayLike | None = None,
    ) -> None:
        self.translational_stiffness = _stiffness("translational_stiffness", translational_stiffness)
        """K_t, shape (3, 3) [N/m], or None."""
        self.rotational_stiffness = _stiffness("rotational_stiffness", rotational_stiffness)
        """K_r, shape (3, 3) [N·m/rad], or None."""
        self.free_direction = None if free_direction is None else direction("free_direction", free_direction)
        """n, a unit vector, shape (3,), or None."""
        linear, angular = self.translational_stiffness, self.rotational_stiffness
        if linear is None and angular is None:
            raise InvalidArgumentError(
                "translational_stiffness", "or rotational_stiffness must be given: nothing is held"
            )
        if self.free_direction is not None:
            if linear is None:
                raise InvalidArgumentError("free_direction", "needs a translational_stiffness, which acts across it")
            across = np.eye(3) - np.outer(self.free_direction, self.free_direction)
            linear = across @ linear @ across
        turning = None if angular is None else angular - 0.5 * np.trace(angular) * np.eye(3)  # −G
        pose = _goal(goal, needs_rotation=angular is not None)
        super().__init__(frame, pose, stiffness=linear, turning=turning, translates=linear is not None)


def _stiffness(name: str, value: ArrayLike | None) -> Array | None:
    if value is None or (isinstance(value, (int, float, np.number)) and value == 0):
        return None
    return gain(name, value, 3)


def _goal(goal: Any, needs_rotation: bool) -> Pose:
    if isinstance(goal, (Pose, pin.SE3)):
        return check_pose("goal", goal)
    array = finite_array("goal", goal)
    if array.shape != (3,):
        return check_pose("goal", array)
    if needs_rotation:
        raise InvalidArgumentError("goal", "must be a pose for a rotational_stiffness, but is a point")
    return Pose(array, np.eye(3))
