"""An objective whose derivative is known."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from phcontrol.simulation.log import Log
from phcontrol.simulation.log_slopes import LogSlopes


@runtime_checkable
class SmoothObjective(Protocol):
    """A number that is a smooth function of the samples of a log, with its derivative: what ``tune`` has gradients of.

    Example:
        >>> import numpy as np
        >>> from phcontrol import LogSlopes, SmoothObjective
        >>> class Speed:
        ...     def __call__(self, log):
        ...         return float((log.velocity**2).mean())
        ...     def slopes(self, log):
        ...         return LogSlopes(velocity=2.0 * log.velocity / log.velocity.size)
        >>> isinstance(Speed(), SmoothObjective), isinstance(np.max, SmoothObjective)
        (True, False)
    """

    def __call__(self, log: Log) -> float:
        """Return the number; smaller is better."""

    def slopes(self, log: Log) -> LogSlopes:
        """Return how it changes with each sample."""
