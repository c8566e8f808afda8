"""What comes from a driver or a law at run time: taken over if it makes sense, never an exception."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._validation import Array

IMPLAUSIBLE_IN_A_ROW = 3
"""Values that are not used before the last good one no longer stands in for them."""


def real_array(value: Any, shape: tuple[int, ...], *, finite: bool = True) -> Array | None:
    """Return a read-only float64 copy of real numbers of a shape, or None for anything else; never raises.

    Nothing is converted that would change its meaning: no booleans, complex numbers, texts or objects, and no scalar
    where a vector is expected. Without ``finite`` NaN passes (an object that is not seen), infinity never does.
    """
    try:
        raw = value if type(value) is np.ndarray else np.asarray(value)
        if raw.dtype.kind not in "fiu" or raw.shape != shape:
            return None
        array: Array = np.array(raw, dtype=np.float64)
        # NaN or infinity in it makes the product so, as numbers beyond 1e154 do
        if not math.isfinite(array.dot(array)) and (~np.isfinite(array) if finite else np.isinf(array)).any():
            return None
    except Exception:  # whatever a foreign object raises when it is asked for its numbers
        return None
    array.flags.writeable = False
    return array


class SignalBorder:
    """The border of one measured signal: what cannot be true is not used, and the last good value stands in for it.

    For two values in a row; with the third the last good one is no longer trusted either, and the next that lies
    within the bounds is believed wherever it is.

    Args:
        lowest: what no true value is below, shape (m,).
        highest: what no true value is above, shape (m,).
        jumps: (value, last value, seconds between) → whether the signal cannot have changed like that.
        may_be_nan: whether NaN is a value of the signal.
    """

    def __init__(
        self,
        lowest: Array,
        highest: Array,
        jumps: Callable[[Array, Array, float], bool],
        *,
        may_be_nan: bool = False,
    ) -> None:
        self._lowest, self._highest, self._jumps, self._finite = lowest, highest, jumps, not may_be_nan
        self.value: Array | None = None
        """The last good value; None before the first."""
        self.age = np.inf
        """How old it is [s]."""
        self.rejected_in_a_row = 0
        """Values not used since the last good one."""

    @property
    def is_trusted(self) -> bool:
        """Whether the last good value still stands in for those that were not used."""
        return self.rejected_in_a_row < IMPLAUSIBLE_IN_A_ROW

    def current(self, oldest: float) -> Array | None:
        """Return the last good value if it is trusted and not older than ``oldest`` [s]."""
        return self.value if self.is_trusted and self.age <= oldest else None

    def elapse(self, seconds: float) -> None:
        """Let time pass."""
        self.age += seconds

    def forget(self) -> None:
        """Start anew: the signal is not measured."""
        self.value, self.age, self.rejected_in_a_row = None, np.inf, 0

    def forgive(self) -> None:
        """Trust the last good value again."""
        self.rejected_in_a_row = 0

    def offer(self, value: Any, age: float) -> bool:
        """Take a value of an age [s] over if it makes sense and is newer; return whether it made sense."""
        array = real_array(value, self._lowest.shape, finite=self._finite)
        if array is None or np.logical_or.reduce((array < self._lowest) | (array > self._highest)):
            return self._reject()
        newer = age < self.age
        if newer and self.value is not None and self.is_trusted and self._jumps(array, self.value, self.age):
            return self._reject()
        self.rejected_in_a_row = 0
        if newer:
            self.value, self.age = array, age
        return True

    def _reject(self) -> bool:
        self.rejected_in_a_row += 1
        return False
