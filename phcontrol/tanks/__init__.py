"""Energy tanks, and the actions that they pay for: what is not passive, made passive."""

from phcontrol.tanks.action import Action
from phcontrol.tanks.energy_tank import EnergyTank, TankFlow
from phcontrol.tanks.external_action import ExternalAction
from phcontrol.tanks.posture_action import PostureAction
from phcontrol.tanks.stiffness import Stiffness
from phcontrol.tanks.stiffness_action import StiffnessAction

__all__ = [
    "Action",
    "EnergyTank",
    "ExternalAction",
    "PostureAction",
    "Stiffness",
    "StiffnessAction",
    "TankFlow",
]
