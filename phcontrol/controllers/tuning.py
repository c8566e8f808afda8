"""Gains that suit a robot."""

from __future__ import annotations

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array, positive
from phcontrol.mechanics.system import MechanicalSystem

BANDWIDTH = 4.0
"""Of default gains [rad/s]."""
DAMPING_RATIO = 1.0
"""Of default gains."""


class Tuning:
    """What default gains are made from: the arm at a goal, a bandwidth ω and a damping ratio ζ.

    Args:
        system: the model of the arm.
        goal: where the law should rest: a posture [rad], or what else it takes for a goal.
        posture: at which the arm's inertia is taken [rad].
        bandwidth: ω [rad/s].
        damping_ratio: ζ.
    """

    def __init__(
        self, system: MechanicalSystem, goal: Array, posture: Array, bandwidth: float, damping_ratio: float
    ) -> None:
        self.system, self.goal = system, goal
        self.bandwidth = positive("bandwidth", bandwidth)
        self.damping_ratio = positive("damping_ratio", damping_ratio)
        self._at = system.at(posture)

    @lazy
    def stiffness(self) -> Array:
        """K_p = max(ω²M_ii, 0.8 dᵢ(0)) [N·m/rad]: friction around rest leaves a time constant of about a second."""
        stiffness: Array = np.maximum(self.bandwidth**2 * self._inertia, 0.8 * self._at.damping)
        return stiffness

    @lazy
    def damping(self) -> Array:
        """C = 2ζ sqrt(K_p M_ii) [N·m·s/rad]."""
        damping: Array = 2.0 * self.damping_ratio * np.sqrt(self.stiffness * self._inertia)
        return damping

    @lazy
    def _inertia(self) -> Array:
        return np.diag(self._at.mass_matrix)
