"""A scene in which nothing is to be seen."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState


class EmptyScene:
    """Nothing to see: a camera finds no object in its image, and says so by features that are NaN."""

    state_size = 0

    def initial_state(self) -> Array:
        """Return nothing: there is no state."""
        return np.zeros(0)

    def rate(self, x: MechanicalState, state: Array) -> Array:
        """Return nothing."""
        return np.zeros(0)

    def features(self, x: MechanicalState, state: Array) -> Array:
        """Return NaN, shape (3,)."""
        return np.full(3, np.nan)
