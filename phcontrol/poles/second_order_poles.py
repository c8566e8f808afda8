"""The poles of laws without a state of their own."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from phcontrol.poles.poles import SHARE, Placed, Poles


class SecondOrderPoles(Poles):
    """λ² + (d + c)λ + k = λ² + 2ζωλ + ω² of energy shaping: k = ω², c = 2ζω − d.

    Where friction alone damps more, d ≥ 2ζω, no positive c does that. The law then damps a tenth of 2ζω beside, and the
    slower pole is put where that of the specification is: at ω for ζ < 1, else at ω(ζ − (ζ² − 1)^½).
    """

    kinds: ClassVar[dict[str, str]] = {"stiffness": "force", "damping": "force"}

    def place(self, friction: float) -> Placed:
        """Return k and c."""
        omega, desired = self.bandwidth, self.pair[1]
        injected = max(desired - friction, SHARE * desired)
        total = injected + friction
        exact = total <= desired * (1.0 + 1e-9)
        stiffness = omega**2
        if not exact:
            ratio = max(self.damping_ratio, 1.0)
            slow = omega * (ratio - math.sqrt(ratio**2 - 1.0))
            if total > 2.0 * slow:
                stiffness = slow * (total - slow)
        poles = np.roots([1.0, total, stiffness]).astype(complex)
        return Placed({"stiffness": stiffness, "damping": injected}, poles, exact)
