"""Springs that hold what a force leaves free."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, direction, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.pose import check_pose
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.frame_spring import FrameSpring
from phcontrol.potentials.potential import Potential, Sum
from phcontrol.potentials.single_joint_spring import SingleJointSpring


class Holding(Sum):
    """Springs on where a frame is across a direction, how it is turned, and where one joint is.

        Ψ = ½k_t|P(r − r₀)|² + k_r(3 − tr(R₀ᵀR))/2 + ½k_e(q_e − q_e0)²,   P = 1 − n nᵀ

    For an arm that presses along n: everything but the pressing is held, and a redundant arm's elbow too. A spring on
    all joints instead would bias the force. It is the sum of a ``FrameSpring`` with n left free, whose rotational
    part is k_r(1 − cos φ) for a turn by φ, and a ``SingleJointSpring``.

    Args:
        frame: the frame.
        reference: a state at the posture to be held: gives r₀, R₀, q_e0.
        normal: n, the direction left free, in the world.
        tangential_stiffness: k_t [N/m]; 0 leaves the position out.
        rotational_stiffness: k_r [N·m/rad]; 0 leaves the orientation out.
        joint: the joint to hold, for instance the elbow of a redundant arm; None for none.
        joint_stiffness: k_e [N·m/rad].

    Raises:
        InvalidArgumentError: a stiffness is negative, the normal is zero, or the reference is no state.
        UnknownNameError: the arm has no such frame or joint.

    Example:
        >>> from phcontrol.potentials import Holding
        >>> from phcontrol import MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> Holding("tool", system.at(system.robot.home), [0.0, 0.0, 1.0], joint="elbow_roll")
        FrameSpring('tool') + SingleJointSpring('elbow_roll')
    """

    def __init__(
        self,
        frame: str,
        reference: MechanicalState,
        normal: ArrayLike,
        *,
        tangential_stiffness: float = 200.0,
        rotational_stiffness: float = 5.0,
        joint: str | None = None,
        joint_stiffness: float = 5.0,
    ) -> None:
        self.frame, self.joint = frame, joint
        self.tangential_stiffness = number("tangential_stiffness", tangential_stiffness, minimum=0.0)
        self.rotational_stiffness = number("rotational_stiffness", rotational_stiffness, minimum=0.0)
        self.joint_stiffness = number("joint_stiffness", joint_stiffness, minimum=0.0)
        if not isinstance(reference, MechanicalState):
            raise InvalidArgumentError(
                "reference", f"must be a state of the arm, system.at(position), but is {type(reference).__name__}"
            )
        free = direction("normal", normal)
        self._posture: Array = np.array(reference.position)
        pose = check_pose("reference", reference.placement(frame))
        terms: list[Potential] = []
        if self.tangential_stiffness or self.rotational_stiffness:
            spring = FrameSpring(
                frame,
                pose,
                translational_stiffness=self.tangential_stiffness,
                rotational_stiffness=self.rotational_stiffness,
                free_direction=free if self.tangential_stiffness else None,
            )
            terms.append(spring)
        if joint is not None:
            index = reference.system.robot.joint_index(joint)
            if self.joint_stiffness:
                terms.append(SingleJointSpring(joint, float(self._posture[index]), self.joint_stiffness))
        super().__init__(*terms)

    @property
    def posture(self) -> Array:
        """Where it holds, shape (n,) [rad]."""
        return self._posture

    def check(self, system: MechanicalSystem) -> None:
        """Raise an error unless the arm has as many joints as the posture, the frame, and the joint."""
        super().check(system)
        if self._posture.size != system.n:
            message = f"must be a state of this arm, of {system.n} joints, but has {self._posture.size}"
            raise InvalidArgumentError("reference", message)
