"""The base of shaped laws that damp the joints by a constant matrix."""

from __future__ import annotations

from phcontrol._validation import Array
from phcontrol.controllers.parameters import Gain
from phcontrol.controllers.shaped_law import ShapedLaw
from phcontrol.mechanics.state import MechanicalState


class JointDampedLaw(ShapedLaw):
    """Laws about a potential that damp by −C Gᵀv̂.

    Args:
        damping: C, positive definite [N·m·s/rad].
    """

    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)

    def prepare(self) -> None:
        """Form G C Gᵀ where it is the same everywhere."""
        super().prepare()
        G = self.system.constant_input
        self._joint_damping: Array = self.damping if G is None else G @ self.damping @ G.T

    def joint_damping(self, t: float, x: MechanicalState) -> Array:
        """Return G C Gᵀ, shape (n, n) [N·m·s/rad]."""
        if self.system.varying_input is None:
            return self._joint_damping
        G = x.input_matrix
        damping: Array = G @ self.damping @ G.T
        return damping

    @property
    def injected_damping(self) -> Array | None:
        """C, shape (n, n) [N·m·s/rad]."""
        return self.damping
