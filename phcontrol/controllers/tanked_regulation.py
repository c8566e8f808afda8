"""A regulation of the contact force that an energy tank pays for."""

from __future__ import annotations

from phcontrol._validation import Array
from phcontrol.controllers.regulated_law import RegulatedLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.tanked_law import TankedLaw
from phcontrol.controllers.target import Drive, Target
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.tanks.energy_tank import Payment


class TankedRegulation(TankedLaw, RegulatedLaw):
    """Laws whose virtual position a regulation moves, as far as the tank pays for the energy that this puts in.

    Moved by r = κ(f_e − f_d), q_f puts the power P = −(∂H_d/∂e)ᵀr into the spring. Here q̇_f = ω r and
    ẋ_t = … − ω_t P/x_t: on (error, virtual_position, tank) r enters by the column

        (−ω 1, ω 1, (ω_t/x_t)(∂H_d/∂e)ᵀ),

    which brings in (ω − ω_t)P ≤ 0 whatever r is: nothing, or what a full tank lets off. So the law is passive
    from f_e to ŷ, and drives nothing from outside. Actions beside it, and it, may use half the largest power each.
    """

    @property
    def pays(self) -> bool:
        """With an action, or with regulation."""
        return super().pays or self.regulation is not None

    @property
    def _part(self) -> float:
        return 0.5 if self.paid and self.regulation is not None else 1.0

    @property
    def caveat(self) -> str:
        """Say what the tank starts with: regulation puts no more in."""
        return super().caveat if self.regulation is None else self._filled

    @property
    def driven_by(self) -> str:
        """Nothing, with regulation: what moves the virtual position comes out of the tank."""
        return super().driven_by if self.regulation is None else ""

    def _paid_rate(
        self, t: float, x: MechanicalState, state: Array, measured: Measured
    ) -> tuple[Array, Payment, float]:
        """Return r [rad/s], what of it the tank pays for, and P [W]."""
        assert self.regulation is not None
        rate = self.regulation.rate(self._measurement(measured, "external_force"))
        power = -float(self.spring_force(t, x, state[:-1]).dot(rate))
        return rate, self.tank.payment(float(state[-1]), power, self._part), power

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """Take back the part of the law's r that is not paid for, and let the tank pay for the rest."""
        law = super().shape(t, x, state, measured)
        if self.regulation is None:
            return law
        rate, payment, power = self._paid_rate(t, x, state, measured)
        law = self.with_faster_goal(law, (payment.opening - 1.0) * rate)
        charge = self.tank.charge(float(state[-1]))
        if charge:
            law.state_rate[-1] -= payment.share * power / charge
        return law

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the law's promise with the tank beside it; r enters by a column that brings no power."""
        target = super().target(t, x, state, measured)
        if self.regulation is None or target.drive is None:
            return target
        _, payment, _ = self._paid_rate(t, x, state, measured)
        port, charge = payment.opening * target.drive.port, self.tank.charge(float(state[-1]))
        if charge:
            port[-1] = -payment.share / charge * (target.gradient[:-1] @ target.drive.port[:-1])
        target.drive = Drive(port, target.drive.signal)
        return target
