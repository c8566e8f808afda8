"""What is true of a closed loop: certificates, modes, gains, equilibria."""

# Written by python -m phcontrol._groups.

from .analysis.casimirs import CasimirCheck, casimirs
from .analysis.certificate import Certificate
from .analysis.certify import certify
from .analysis.detectability import InvariantSet, invariant_set
from .analysis.equilibrium import Equilibrium, equilibrium
from .analysis.force_conditions import ForceConditions, force_control_conditions
from .analysis.l2_gain import GainBound, damping_for_gain, l2_gain, measured_l2_gain
from .analysis.linearization import Linearization, linearize
from .analysis.model_comparison import ModelComparison, compare_models
from .analysis.modes import Mode
from .analysis.safe_set import SafeSet, safe_set
from .analysis.sampled_loop import SampledLoop

__all__ = [
    "CasimirCheck",
    "Certificate",
    "Equilibrium",
    "ForceConditions",
    "GainBound",
    "InvariantSet",
    "Linearization",
    "Mode",
    "ModelComparison",
    "SafeSet",
    "SampledLoop",
    "casimirs",
    "certify",
    "compare_models",
    "damping_for_gain",
    "equilibrium",
    "force_control_conditions",
    "invariant_set",
    "l2_gain",
    "linearize",
    "measured_l2_gain",
    "safe_set",
]
