"""The clock of a control loop, whatever it is."""

from __future__ import annotations

from collections.abc import Callable

from phcontrol._validation import real_array
from phcontrol.exceptions import InvalidArgumentError, PHControlError

_FARTHEST = 1e12  # that a clock shows [s]


class LoopClock:
    """Reads a clock that may show anything.

    Args:
        function: returns the time [s].

    Raises InvalidArgumentError where that is no function.
    """

    def __init__(self, function: Callable[[], float]) -> None:
        if not callable(function):
            raise InvalidArgumentError("clock", f"must be a function that returns the time, but is {function!r}")
        self._function, self._shown = function, 0.0
        self.error: Exception | None = None
        """Why the last look showed no time; None where it did."""

    def now(self) -> float:
        """Return what the clock shows, and where that is no time what it showed before [s]; never raises."""
        try:
            told = self._function()
            value = told if type(told) is float else real_array(told, ())
            if value is None or not abs(float(value)) < _FARTHEST:
                raise PHControlError(f"the clock of the loop shows {told!r}, which is no time in seconds")
            self.error, self._shown = None, float(value)
        except Exception as error:  # of whatever is asked for the time
            self.error = error
        return self._shown
