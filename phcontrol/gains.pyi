"""Gains from a specification, and gains that are tuned."""

# Written by python -m phcontrol._groups.

from .design.design_gains import design_gains
from .design.designed_gains import DesignedGains
from .design.desired_bandwidth import DesiredBandwidth
from .design.desired_gain import DesiredGain
from .design.desired_settling import DesiredSettling
from .design.quadratic_cost import QuadraticCost
from .design.sampling_budget import SamplingBudget
from .design.smooth_objective import SmoothObjective
from .design.specification import Specification
from .design.torque_budget import TorqueBudget
from .design.trial import Trial
from .design.tune import tune
from .design.tuned_gains import TunedGains

__all__ = [
    "DesignedGains",
    "DesiredBandwidth",
    "DesiredGain",
    "DesiredSettling",
    "QuadraticCost",
    "SamplingBudget",
    "SmoothObjective",
    "Specification",
    "TorqueBudget",
    "Trial",
    "TunedGains",
    "design_gains",
    "tune",
]
