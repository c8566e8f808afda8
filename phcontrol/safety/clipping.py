"""The one place where torques are clipped."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array


def clipped(torque: Array, low: Array, high: Array) -> Array:
    """Return the torque nearest to one within bounds, shapes (n,) all [N·m]; NaN stays NaN."""
    result: Array = np.minimum(np.maximum(torque, low), high)
    return result
