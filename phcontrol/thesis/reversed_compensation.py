"""The classical law (4.61) with the measured force of the environment counted the other way."""

from __future__ import annotations

from phcontrol._validation import Array
from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.shaping import Shaping
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import Measured


class ReversedCompensation(ClassicalImpedance):
    """u = ū + f_e, where (4.61) prints u = ū − f_e: with f_e of the other sign, the force of the arm on the body.

    The force is then felt twice, not cancelled: f_e itself pushes the arm back, and the law adds as much again. The
    thesis gives no such sign, (4.65) and the port of (2.19) give the other; its certificate fails. It is here
    because the printed order of impacts needs it.
    """

    name = "reversed_compensation"

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State what (4.61) does, with the cancelled force reversed."""
        stated = super().shape(t, x, state, measured)
        return stated._replace(cancelled_force=-self._measurement(measured, "external_force"))
