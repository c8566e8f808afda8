"""What comes from a driver or a law at run time: taken over if it makes sense, never an exception."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._validation import Array, real_array

IMPLAUSIBLE_IN_A_ROW = 3
"""Values that are not used before the last good one no longer stands in for them."""


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
