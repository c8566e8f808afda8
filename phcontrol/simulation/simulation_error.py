"""Errors of a simulation, which carry its log."""

from __future__ import annotations

from phcontrol.exceptions import PHControlError
from phcontrol.simulation.log import Log


class SimulationError(PHControlError):
    """A simulation could not go on. ``log`` holds everything up to the last good step.

    Example:
        >>> import numpy as np
        >>> from phcontrol import NOTHING, Command, EnergyShaping, MechanicalSystem, SimulationError, load_robot
        >>> from phcontrol import simulate
        >>> class Wild(EnergyShaping):
        ...     name = "wild"
        ...     def evaluate(self, t, x, state, measured=NOTHING):
        ...         return Command(np.full(2, np.nan if t > 0.1 else 0.0), np.zeros(0))
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> try:
        ...     simulate(system, Wild.tuned(system), duration=1.0, dt=0.01)
        ... except SimulationError as error:
        ...     print(error.log.time[-1].round(2), "s went well")
        0.1 s went well
    """

    def __init__(self, message: str, log: Log) -> None:
        super().__init__(message)
        self.log = log


class SimulationInterrupted(SimulationError, KeyboardInterrupt):  # noqa: N818 - it is no error
    """The user stopped a simulation. ``log`` holds everything up to that moment.

    Example:
        >>> from phcontrol import NOTHING, EnergyShaping, MechanicalSystem, SimulationInterrupted, load_robot
        >>> from phcontrol import simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> class Stopping(EnergyShaping):
        ...     name = "stopping"
        ...     def evaluate(self, t, x, state, measured=NOTHING):
        ...         if t > 0.1:
        ...             raise KeyboardInterrupt  # as Ctrl-C does
        ...         return super().evaluate(t, x, state, measured)
        >>> try:
        ...     simulate(system, Stopping.tuned(system), duration=1.0, dt=0.01)
        ... except SimulationInterrupted as error:
        ...     print(error.log.time[-1].round(2), "s were done")
        0.1 s were done
    """

    exit_code = 130
