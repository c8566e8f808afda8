"""Energies of the configuration that a law shapes."""

from phcontrol.potentials.frame_spring import FrameSpring
from phcontrol.potentials.frame_wrench import FrameWrench
from phcontrol.potentials.holding import Holding
from phcontrol.potentials.joint_force import JointForce
from phcontrol.potentials.joint_spring import JointSpring
from phcontrol.potentials.point_force import PointForce
from phcontrol.potentials.position_potential import PositionPotential
from phcontrol.potentials.potential import Goal, Potential, Sum
from phcontrol.potentials.single_joint_spring import SingleJointSpring

__all__ = [
    "FrameSpring",
    "FrameWrench",
    "Goal",
    "Holding",
    "JointForce",
    "JointSpring",
    "PointForce",
    "PositionPotential",
    "Potential",
    "SingleJointSpring",
    "Sum",
]
