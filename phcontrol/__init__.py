"""Energy-based control of robot arms, with a certificate for every controller."""

from phcontrol._version import __version__
from phcontrol.analysis.certificate import Certificate, certify
from phcontrol.controllers.controller import Command, Controller, Shaping, Target
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.controllers.registry import CONTROLLERS, make_controller
from phcontrol.exceptions import (
    DataFileError,
    InvalidArgumentError,
    MissingMeasurementError,
    NonFiniteTorqueError,
    PHControlError,
    RobotDescriptionError,
    SimulationError,
    SimulationInterrupted,
    UnknownNameError,
)
from phcontrol.mechanics.friction import StribeckFriction
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.potentials import GripperSpring
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import Log, PowerBalance

__all__ = [
    "CONTROLLERS",
    "INTEGRATORS",
    "NOTHING",
    "Certificate",
    "Command",
    "Controller",
    "DataFileError",
    "EnergyShaping",
    "ForceFeedback",
    "GripperSpring",
    "InvalidArgumentError",
    "Log",
    "Measured",
    "MechanicalState",
    "MechanicalSystem",
    "MissingMeasurementError",
    "NonFiniteTorqueError",
    "PHControlError",
    "PowerBalance",
    "Robot",
    "RobotDescriptionError",
    "Shaping",
    "SimulationError",
    "SimulationInterrupted",
    "StribeckFriction",
    "Target",
    "UnknownNameError",
    "__version__",
    "certify",
    "load_robot",
    "make_controller",
    "simulate",
]
