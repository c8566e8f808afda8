"""Every error and warning."""

# Written by python -m phcontrol._groups.

from .compilation.errors import CompilationError, CompilationWarning, NotTraceableError
from .controllers.law_error import LawError
from .exceptions import (
    AnswerError,
    DataFileError,
    InvalidArgumentError,
    MissingMeasurementError,
    NonFiniteTorqueError,
    ObjectLostError,
    PHControlError,
    RobotDescriptionError,
    RobotDescriptionWarning,
    UnknownNameError,
)
from .runtime.arm_error import ArmError
from .simulation.simulation_error import SimulationError, SimulationInterrupted
from .sweeps.engine import EngineError
from .trajectories.inverse_kinematics import UnreachableTargetError

__all__ = [
    "AnswerError",
    "ArmError",
    "CompilationError",
    "CompilationWarning",
    "DataFileError",
    "EngineError",
    "InvalidArgumentError",
    "LawError",
    "MissingMeasurementError",
    "NonFiniteTorqueError",
    "NotTraceableError",
    "ObjectLostError",
    "PHControlError",
    "RobotDescriptionError",
    "RobotDescriptionWarning",
    "SimulationError",
    "SimulationInterrupted",
    "UnknownNameError",
    "UnreachableTargetError",
]
