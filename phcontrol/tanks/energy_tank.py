"""A store of energy out of which a law pays for what is not passive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from phcontrol._smooth import smooth
from phcontrol._validation import number, positive
from phcontrol.exceptions import InvalidArgumentError

_KEPT = 0.9
"""Of the damping's power, at most; the rest is lost, so that H_d + ½x_t² falls wherever the arm moves."""

_FASTEST_LEAK = 1.0  # [1/s]: far below what held torques resolve


class Payment(NamedTuple):
    """What a tank lets through of what moves the state of a law, and pays for."""

    opening: float
    """ω, between 0 and 1: the part of the motion that happens, with the power ω P."""
    share: float
    """ω_t: ω_t P is what the tank gives; ω, or less where P < 0 and the tank is full."""


class TankFlow(NamedTuple):
    """What the valves of a tank let through at one state."""

    opening: float
    """ω, between 0 and 1: the part of the action that acts."""
    refill: float
    """σ, between 0 and 0.9: the part of the damping's power that is kept."""
    lost: float
    """Power that leaks and that is let off, ≥ 0 [W]."""
    charge: float
    """x_t [√J]."""
    rate: float
    """ẋ_t = (−ω P_a + σ P_d − lost)/x_t [√J/s]."""

    def per_charge(self, power: float) -> float:
        """Return a power over x_t; 0 of an empty tank, whose valves are closed."""
        return power / self.charge if self.charge else 0.0


@dataclass(frozen=True)
class EnergyTank:
    """A tank that holds ½x_t², gives what an action does to the arm, and is refilled by what the damping takes.

        ẋ_t = (−ω aᵀv̂ + σ v̂ᵀΔv̂ − lost)/x_t

    ω closes towards the lower bound, over ``ramp``, and so far that no more than ``largest_power`` flows out; σ closes
    towards the upper one, where what an action takes out of the arm is let off too, as is all beyond ``largest_power``.
    A little leaks, down to the lower bound, so that what is not used is forgotten in the end. So the level stays
    between the bounds in continuous time. Below the lower bound (a state that no run reaches) the tank fills, and gives
    nothing.

    **Held torques.** With h·largest_power ≤ 0.88·ramp (``longest_period``; control loops refuse a longer h) the level
    stays above the lower bound too. The balance is kept to the error of the hold only: the tank pays for the power at
    the start of a period, and the arm receives the torque times the velocity as it changes meanwhile. An action that is
    stiff against h can make energy of it, without end: −8 tanh(q̇/0.05) N·m on a Panda raised H_d + ½x_t² from 2.18 to
    2.60 J within 2 s at 1 ms, and dry friction that chatters filled the tank. Euler's step of x_t adds ½ẋ_t²h² to
    what is filled.

    **Limits.** Where a torque is clipped, or changed by a filter, a loop lets the tank pay for what that puts into H_d
    beyond what is lost (``Controller.rate_under_limits``): damping that did not act has filled nothing. What an empty
    tank cannot pay is what the same limits put into a law without a tank.

    As the state of a law it is s = x_t − x_t(0), so that laws start with zeros. A. Dietrich, C. Ott and S. Stramigioli,
    "The passivity of projected null space compliance control via energy tanks", IEEE Robotics and Automation Letters
    1(1), 2016.

    Args:
        initial: level at the start [J].
        lowest: bound below which it never falls, above 0 [J].
        highest: bound above which it is never filled [J].
        ramp: over how much of the level valves open and close [J].
        largest_power: that it gives, and that it takes of the damping or of an action [W].
        leak: λ, the rate at which x_t fades, at most 1 [1/s].

    Raises:
        InvalidArgumentError: bounds that are swapped, a start that is not between them, ramps that meet, a leak
            above 1.

    Example:
        >>> from phcontrol import EnergyTank
        >>> tank = EnergyTank(initial=1.0)
        >>> flow = tank.flow(0.0, power=3.0, damping_power=0.5)
        >>> flow.opening, round(flow.rate * flow.charge, 3)
        (1.0, -2.55)
    """

    initial: float = 2.0
    lowest: float = 0.02
    highest: float = 5.0
    ramp: float = 0.25
    largest_power: float = 100.0
    leak: float = 1e-5

    def __post_init__(self) -> None:
        for name in ("initial", "lowest", "highest", "ramp", "largest_power", "leak"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        number("leak", self.leak, maximum=_FASTEST_LEAK)
        if self.lowest >= self.highest:
            message = f"must be below highest, but they are {self.lowest:g} J and {self.highest:g} J: swapped?"
            raise InvalidArgumentError("lowest", message)
        if not self.lowest <= self.initial <= self.highest:
            message = f"must be between lowest, {self.lowest:g} J, and highest, {self.highest:g} J"
            raise InvalidArgumentError("initial", f"{message}, but is {self.initial:g} J")
        if 2.0 * self.ramp > self.highest - self.lowest:
            message = f"must be at most half of what lies between the bounds, but is {self.ramp:g} J"
            raise InvalidArgumentError("ramp", message)

    @property
    def longest_period(self) -> float:
        """The longest h with which Euler's step of x_t cannot pass the lower bound [s].

        A step takes h ω P ≤ h·largest_power·(3s² − 2s³) with s·ramp the level above the bound; x_t stays above while
        that is at most s·ramp, and (3s² − 2s³)/s is at most 9/8.
        """
        return 0.88 * self.ramp / self.largest_power

    def charge(self, state: float) -> float:
        """Return x_t = s + x_t(0) [√J]."""
        return state + math.sqrt(2.0 * self.initial)

    def level(self, state: float) -> float:
        """Return ½x_t² [J]."""
        return 0.5 * self.charge(state) ** 2

    def state(self, level: float) -> float:
        """Return the state s of a level [J]."""
        return math.sqrt(2.0 * number("level", level, minimum=0.0)) - math.sqrt(2.0 * self.initial)

    def payment(self, state: float, power: float, part: float = 1.0) -> Payment:
        """Return what the valves let through of a motion of the law's own state, ẋ_t = … − ω_t P/x_t.

        Args:
            state: s [√J].
            power: P, what the whole motion would give to the law's storage function [W]; negative where it takes.
            part: of ``largest_power`` that it may use.
        """
        level = self.level(state)
        opening = _capped(self._valve(level), power, part * self.largest_power)
        if power >= 0.0 or opening == 0.0:
            return Payment(opening, opening)
        returned = -opening * power
        kept = (1.0 - self._fullness(level)) * min(returned, part * self.largest_power) / returned
        return Payment(opening, opening * min(1.0, kept))

    def spare(self, state: float, power: float, spent: float) -> float:
        """Return what the tank gives of a power, beside what it spends already [W]: together at most ω·largest_power.

        Args:
            state: s [√J].
            power: that is asked for [W]; 0 is given where it is negative.
            spent: −x_t ẋ_t [W].
        """
        most = self._valve(self.level(state)) * self.largest_power
        return max(0.0, min(power, most - max(0.0, spent)))

    def _valve(self, level: float) -> float:
        """Return ω but for the largest power: closed at the lower bound."""
        return smooth((level - self.lowest) / self.ramp)

    def _fullness(self, level: float) -> float:
        """Return 0 to 1, towards the upper bound."""
        return smooth((level - self.highest) / self.ramp + 1.0)

    def flow(self, state: float, power: float, damping_power: float, part: float = 1.0) -> TankFlow:
        """Return what the valves let through.

        Args:
            state: s [√J].
            power: P_a = aᵀv̂, what the whole action would give to the arm [W]; negative where it takes.
            damping_power: P_d = v̂ᵀΔv̂ ≥ 0, what the damping takes [W].
            part: of ``largest_power`` that the action may use.
        """
        charge = self.charge(state)
        level = 0.5 * charge * charge
        largest = part * self.largest_power
        valve, fullness = self._valve(level), self._fullness(level)
        leak, opening = 2.0 * self.leak * valve * level, _capped(valve, power, largest)
        refill = _KEPT * (1.0 - fullness) * smooth(level / self.lowest)
        refill *= self.largest_power / max(refill * damping_power, self.largest_power)
        returned = max(0.0, -opening * power)
        lost = leak + returned - (1.0 - fullness) * min(returned, largest)
        rate = (refill * damping_power - opening * power - lost) / charge if charge else 0.0
        return TankFlow(opening, refill, lost, charge, rate)


def _capped(valve: float, power: float, largest: float) -> float:
    """Return ω: the valve's, and such that no more than the largest power flows out."""
    return valve * (largest / max(power, largest))
