"""The part of a frame's stiffness that changes with time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.pose import Pose
from phcontrol.mechanics.state import MechanicalState
from phcontrol.potentials.frame_potential import vee
from phcontrol.tanks.action import Action
from phcontrol.tanks.stiffness import Stiffness


class StiffnessAction(Action):
    """a = −𝒥ᵀF_v: what the wrench of a spring is with K(t), less what it is with the constant part K_c.

        F_v = ((K_t(t) − K_t)e, R vee(G_v R_e − R_eᵀG_v)),   G_v = ½tr(K_v)1 − K_v,  K_v = K_r(t) − K_r

    The constant part has a potential; this has none (F. Ferraguti, C. Secchi and C. Fantuzzi, "A tank-based approach to
    impedance control with variable stiffness", ICRA 2013).

    Args:
        frame: its name.
        goal: t -> the pose of the spring's goal.
        stiffness: K(t).
        translational: K_t, the constant part, shape (3, 3), axes of the world [N/m].
        rotational: K_r, likewise, axes of the goal [N·m/rad].
    """

    def __init__(
        self,
        frame: str,
        goal: Callable[[float], Pose],
        stiffness: Stiffness,
        translational: Array,
        rotational: Array,
    ) -> None:
        self.frame, self.goal, self.stiffness = frame, goal, stiffness
        self._constant = translational, rotational
        self.duration = stiffness.duration

    def torque(self, t: float, x: MechanicalState) -> Array:
        """Return a, shape (n,) [N·m]."""
        kinematics, goal = x.frame_kinematics(self.frame), self.goal(t)
        translational, rotational = self.stiffness.translational(t), self.stiffness.rotational(t)
        wrench: Array = np.zeros(6)
        if translational is not None:
            change = translational - self._constant[0]
            wrench[:3] = change.dot(kinematics.translation - goal.translation)
        if rotational is not None:
            change = rotational - self._constant[1]
            turning = change - 0.5 * np.trace(change) * np.eye(3)  # −G_v
            wrench[3:] = vee(goal.rotation @ turning @ kinematics.rotation.T)
        torque: Array = wrench.dot(kinematics.jacobian)
        return -torque
