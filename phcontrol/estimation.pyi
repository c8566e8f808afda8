"""What an arm carries and how it rubs, from logs."""

# Written by python -m phcontrol._groups.

from .identification.excitation import ExcitingTrajectory, exciting_trajectory
from .identification.identified import Identification
from .identification.identify import identify
from .identification.motion import Motion

__all__ = [
    "ExcitingTrajectory",
    "Identification",
    "Motion",
    "exciting_trajectory",
    "identify",
]
