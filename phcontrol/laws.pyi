"""Laws, what they are made of, their schedules and energy tanks."""

# Written by python -m phcontrol._groups.

from .controllers.adaptive_payload import AdaptivePayload
from .controllers.cartesian_impedance import CartesianImpedance
from .controllers.cartesian_tracking import CartesianTracking
from .controllers.classical_force import ClassicalForceControl
from .controllers.classical_impedance import ClassicalImpedance
from .controllers.command import Command
from .controllers.controller import Controller
from .controllers.energy_shaping import EnergyShaping
from .controllers.event_schedule import EventSchedule, HandOver, Phase, Switch
from .controllers.events import After, Event, Lost, Moment, Seen, Settled, Touched, When
from .controllers.force_control import ForceControl
from .controllers.force_feedback import ForceFeedback
from .controllers.force_regulation import ForceRegulation
from .controllers.hamiltonian_servo import HamiltonianServo
from .controllers.impedance_grasping import ImpedanceGrasping, RestLengthPort
from .controllers.integral_action import IntegralAction
from .controllers.parameters import Flag, Gain, Matrix, NonNegative, Parameter, Positive, PositiveVector, Vector
from .controllers.passive_port import PassivePort
from .controllers.reduction_servo import ReductionServo
from .controllers.registry import CONTROLLERS, make_controller, register
from .controllers.schedule import Schedule
from .controllers.shaping import Shaping
from .controllers.tanked_law import TankedLaw
from .controllers.target import Target
from .controllers.total_force_rejection import TotalForceRejection
from .controllers.trajectory_tracking import TrajectoryTracking
from .controllers.virtual_position import VirtualPosition, virtual_position
from .controllers.with_tank import with_tank
from .tanks.action import Action
from .tanks.energy_tank import EnergyTank
from .tanks.external_action import ExternalAction
from .tanks.posture_action import PostureAction
from .tanks.stiffness import Stiffness

__all__ = [
    "CONTROLLERS",
    "Action",
    "AdaptivePayload",
    "After",
    "CartesianImpedance",
    "CartesianTracking",
    "ClassicalForceControl",
    "ClassicalImpedance",
    "Command",
    "Controller",
    "EnergyShaping",
    "EnergyTank",
    "Event",
    "EventSchedule",
    "ExternalAction",
    "Flag",
    "ForceControl",
    "ForceFeedback",
    "ForceRegulation",
    "Gain",
    "HamiltonianServo",
    "HandOver",
    "ImpedanceGrasping",
    "IntegralAction",
    "Lost",
    "Matrix",
    "Moment",
    "NonNegative",
    "Parameter",
    "PassivePort",
    "Phase",
    "Positive",
    "PositiveVector",
    "PostureAction",
    "ReductionServo",
    "RestLengthPort",
    "Schedule",
    "Seen",
    "Settled",
    "Shaping",
    "Stiffness",
    "Switch",
    "TankedLaw",
    "Target",
    "TotalForceRejection",
    "Touched",
    "TrajectoryTracking",
    "Vector",
    "VirtualPosition",
    "When",
    "make_controller",
    "register",
    "virtual_position",
    "with_tank",
]
