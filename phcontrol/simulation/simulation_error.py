"""Errors of a simulation, which carry its log."""

from __future__ import annotations

from phcontrol.exceptions import PHControlError
from phcontrol.simulation.log import Log


class SimulationError(PHControlError):
    """A simulation could not go on. ``log`` holds everything up to the last good step."""

    def __init__(self, message: str, log: Log) -> None:
        super().__init__(message)
        self.log = log


class SimulationInterrupted(SimulationError, KeyboardInterrupt):  # noqa: N818 - it is no error
    """The user stopped a simulation. ``log`` holds everything up to that moment."""

    exit_code = 130
