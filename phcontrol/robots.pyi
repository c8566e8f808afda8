"""Arms and plants: descriptions, payloads, friction, states, transformations."""

# Written by python -m phcontrol._groups.

from .mechanics.friction import DeclaredFriction, StribeckFriction
from .mechanics.loading import load_robot
from .mechanics.matrix_damping import MatrixDamping
from .mechanics.payload import Payload
from .mechanics.pose import Pose
from .mechanics.potentials import ConstantTorque, GripperSpring
from .mechanics.robot import Robot
from .mechanics.state import MechanicalState
from .mechanics.stop_velocity import StopVelocity
from .mechanics.system import MechanicalSystem
from .mechanics.transformations import (
    CanonicalCheck,
    PassivityCheck,
    check_canonical_transformation,
    check_transformed_passivity,
)
from .mechanics.transformed_system import TransformedSystem, transformed_system

__all__ = [
    "CanonicalCheck",
    "ConstantTorque",
    "DeclaredFriction",
    "GripperSpring",
    "MatrixDamping",
    "MechanicalState",
    "MechanicalSystem",
    "PassivityCheck",
    "Payload",
    "Pose",
    "Robot",
    "StopVelocity",
    "StribeckFriction",
    "TransformedSystem",
    "check_canonical_transformation",
    "check_transformed_passivity",
    "load_robot",
    "transformed_system",
]
