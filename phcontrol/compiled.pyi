"""Laws and loops in C, and their exact derivatives."""

# Written by python -m phcontrol._groups.

from .compilation.compiled_law import compile_law
from .compilation.loop_derivatives import LoopDerivatives
from .compilation.loop_jacobian import LoopJacobian

__all__ = [
    "LoopDerivatives",
    "LoopJacobian",
    "compile_law",
]
