"""What touches or pushes an arm: bodies, disturbances."""

# Written by python -m phcontrol._groups.

from .environments.body import Body
from .environments.compliant_body import CompliantBody
from .environments.contact_geometry import JointContact, SphereContact
from .environments.disturbances import Disturbance, Pulse, Sampled, Sine, Step, Wrench
from .environments.grasp_contact import GraspContact
from .environments.rigid_body import RigidBody

__all__ = [
    "Body",
    "CompliantBody",
    "Disturbance",
    "GraspContact",
    "JointContact",
    "Pulse",
    "RigidBody",
    "Sampled",
    "Sine",
    "SphereContact",
    "Step",
    "Wrench",
]
