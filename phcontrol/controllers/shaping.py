"""What a law may state instead of having its torque derived from its target: a fast path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array

EMPTY: Array = np.zeros(0)
EMPTY.flags.writeable = False


class Shaping(NamedTuple):
    """The desired dynamics of p̂, of which the matching formula makes the torque.

    The adapted momentum is p̂ = p̄ + θ with θ = Tᵀs + ϑ, and the desired dynamics are
    p̂̇ = (J̄₂ − D̄)(p̄ + Tᵀs) + T⁻¹ effort + T⁻¹(f_e − cancelled_force).

    Example:
        >>> import numpy as np
        >>> from phcontrol import NOTHING, EnergyShaping, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping(system, goal=[0.0, 0.0], stiffness=20.0, damping=5.0)
        >>> law.shape(0.0, system.at([0.1, 0.0]), np.zeros(0), NOTHING).effort.shape
        (2,)
    """

    effort: Array
    """T times the rest of F★, shape (n,) [N·m]."""
    velocity: Array | None = None
    """s, shape (n,) [rad/s]; None for zero."""
    acceleration: Array | None = None
    """ṡ along the closed loop, shape (n,) [rad/s²]; goes with ``velocity``."""
    offset_rate: Array | None = None
    """ϑ̇, shape (n,); None for zero."""
    cancelled_force: Array | None = None
    """The measured part of f_e that the law cancels, shape (n,) [N·m]; None for nothing."""
    complete: bool = False
    """Whether ``effort`` holds ∂V/∂q − M ṡ − C s − D s too; then s and ṡ are left out."""
    state_rate: Array = EMPTY
    """Rate of the controller's own state."""
