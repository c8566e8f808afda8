"""What a law that f_e drives does when it is pushed hard, against something that gives way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.neighbourhood import Neighbourhood, spectrum_of
from phcontrol.analysis.rest_point import RestPoint, touched_spring
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

_SHARES = (0.01, 0.05, 0.2, 0.5, 1.0, 2.0)  # of the motors' limits
_ROUNDING = 1e-13  # of the largest rate


def fastest_when_pushed(
    law: Controller, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint, frequencies: tuple[float, ...]
) -> Worst:
    """Return the largest real part of the loop on springs, its answer to f_e taken between 0 and large forces [1/s].

    Where a law is linear in f_e this is what the linearised loop says. One that answers a small force rightly and a
    large one the wrong way round (with its cube, or backwards beyond some size) drives what it touches away from there.
    With the chord of its answer between the force at rest and ± a share of the motors' limits on each joint, in place
    of the slope, the loop on a spring that gives each joint a frequency [rad/s] must fade or stay.
    """
    return Worst.of(_pushed(law, plant, units, rest, frequencies), -np.inf)


def _pushed(
    law: Controller, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint, frequencies: tuple[float, ...]
) -> Iterator[tuple[float, str]]:
    around = Neighbourhood(law, plant, units, rest.time, rest.force)
    y, n = np.concatenate([rest.position, rest.velocity, rest.state]), plant.n
    still, error = around.linearised(y)
    S = around.directions(y)
    inverse, here = np.linalg.inv(S), around.rate(y)
    for share in (*_SHARES, *(-share for share in _SHARES)):
        chords = np.empty((len(y), n))
        for joint, unit in enumerate(units.force):
            push = np.zeros(n)
            push[joint] = share * unit
            chords[:, joint] = (around.rate(y, push) - here) / push[joint]
        rounding = _ROUNDING * float(np.abs(here).max() + np.abs(chords * share * units.force).max())
        for frequency in frequencies:
            spring = touched_spring(law, plant, rest.time, frequency)
            felt = inverse @ chords @ spring @ S[:n]
            unsure = (
                np.abs(inverse).sum(axis=1)[:, None]
                * rounding
                * np.abs((spring / (share * units.force)[:, None]) @ S[:n]).sum(axis=0)
            )
            values, uncertainty = spectrum_of(still - felt, error + unsure)
            words = f"{abs(share):g} of the motors' limits, springs that give each joint {frequency:g} rad/s"
            yield float((values.real - uncertainty).max()), words
