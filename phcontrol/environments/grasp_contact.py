"""An object that fingers close on, if it is between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import positive, text, vector
from phcontrol.environments.contact_geometry import Gap, JointContact
from phcontrol.mechanics.state import MechanicalState


class GraspContact(JointContact):
    """Something between the fingers of a gripper: touched when its joint passes ``position``, and only if it is there.

    It is there while its centre is within ``reach`` of the grip point; what is elsewhere the fingers miss.

    Args:
        joint: the gripper's joint.
        position: where contact begins [rad or m].
        centre: of the object in the world, shape (3,) [m].
        frame: the grip point's frame.
        reach: [m].
        side: as of :class:`JointContact`.

    Example:
        >>> from phcontrol import GraspContact
        >>> contact = GraspContact("gripper", 0.2, centre=[0.5, 0.0, 0.4], frame="tool", reach=0.02)  # [rad], [m]
        >>> contact.record()["kind"]
        'joint'
    """

    def __init__(
        self, joint: str, position: float, centre: ArrayLike, frame: str, reach: float = 0.01, side: str = "below"
    ) -> None:
        super().__init__(joint, position, side)
        self.centre, self.frame = vector("centre", centre, 3), text("frame", frame)
        self.reach = positive("reach", reach)

    def gap(self, x: MechanicalState) -> Gap:
        """Return the joint's distance from the object; of one that is out of reach, how far out that is."""
        distance, slope = super().gap(x)
        beyond = float(np.linalg.norm(x.placement(self.frame).translation - self.centre)) - self.reach
        return Gap(distance, slope) if beyond <= 0.0 else Gap(max(distance, beyond), slope)
