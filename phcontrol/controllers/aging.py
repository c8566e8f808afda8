"""What H_d gains by the clock alone, of a law that changes with time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.controllers.answers import stored
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import Measured

STEP = 2e-4
"""Of the differences in time [s]."""


def aging(
    law: Controller, t: float, x: MechanicalState, state: Array, measured: Measured, gradient: Array, step: float = STEP
) -> float:
    """Return ∂H_d/∂t at the same coordinates [W].

    That is the rate of H_d while the clock runs and arm, law and measurements stand, less ∇H_dᵀ times that of the
    target's coordinates. So Ḣ_d = ∇H_dᵀẋ + ∂H_d/∂t.

    Args:
        law: asked for its storage function and its coordinates.
        t: time; near a switch to another law, whose coordinates are others, the nearest at which no difference
            reaches across it [s].
        x: the state as the law sees it.
        state: the law's own.
        measured: what is measured.
        gradient: ∇H_d there.
        step: of the differences [s].
    """
    time = within_phase(law.phases, t, 2.0 * step, 3.0 * step)  # the next law acts from its time on

    def there(shift: float) -> Array:
        energy = stored(law, time + shift, x, state, measured)
        return np.concatenate([[energy], law.coordinates(time + shift, x, state, measured)])

    rates = central_difference(there, step)
    return float(rates[0] - gradient @ rates[1:])


def within_phase(phases: Sequence[float], t: float, after: float, before: float) -> float:
    """Return the time nearest to t that is so long after the start of its phase and before its end, or between [s]."""
    k = bisect_right(phases, t)
    begin = phases[max(0, k - 1)] + after
    end = phases[k] - before if k < len(phases) else math.inf
    return max(begin, min(t, end)) if begin <= end else 0.5 * (begin + end)
