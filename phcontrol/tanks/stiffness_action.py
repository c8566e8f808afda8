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

        F_v = ((A K_t(t)Aᵀ − K_t)e, R vee(G_v R_e − R_eᵀG_v)),   G_v = ½tr(K_v)1 − K_v,  K_v = K_r(t) − K_r

    The constant part has a potential; this has none (F. Ferraguti, C. Secchi and C. Fantuzzi, "A tank-based approach to
    impedance control with variable stiffness", ICRA 2013).

    Args:
        frame: its name.
        goal: t -> the pose of the spring's goal.
        stiffness: K(t).
        across: A, shape (3, 3): of K_t(t) what acts is A K_t Aᵀ, from its axes into the world's, and less a direction
            that is left free.
        constant: (K_t, K_r), what the potential holds, shape (3, 3) each, axes of the world [N/m] and of the goal
            [N·m/rad].
    """

    def __init__(
        self,
        frame: str,
        goal: Callable[[float], Pose],
        stiffness: Stiffness,
        across: Array,
        constant: tuple[Array, Array],
    ) -> None:
        self.frame, self.goal, self.stiffness = frame, goal, stiffness
        self._across, self._constant = across, constant
        self.duration = stiffness.duration

    def torque(self, t: float, x: MechanicalState) -> Array:
        """Return a, shape (n,) [N·m]."""
        kinematics, goal = x.frame_kinematics(self.frame), self.goal(t)
        translational, rotational = self.stiffness.translational(t), self.stiffness.rotational(t)
        wrench: Array = np.zeros(6)
        if translational is not None:
            change = self._across @ translational @ self._across.T - self._constant[0]
            wrench[:3] = change.dot(kinematics.translation - goal.translation)
        if rotational is not None:
            change = rotational - self._constant[1]
            turning = change - 0.5 * np.trace(change) * np.eye(3)  # −G_v
            wrench[3:] = vee(goal.rotation @ turning @ kinematics.rotation.T)
        torque: Array = wrench.dot(kinematics.jacobian)
        return -torque
