"""Runs of closed loops and their logs."""

# Written by python -m phcontrol._groups.

from .simulation.closed_loop import simulate
from .simulation.integrators import INTEGRATORS
from .simulation.log import Log
from .simulation.log_slopes import LogSlopes
from .simulation.outcome import Outcome
from .simulation.power_balance import PowerBalance
from .simulation.simulate_many import simulate_many

__all__ = [
    "INTEGRATORS",
    "Log",
    "LogSlopes",
    "Outcome",
    "PowerBalance",
    "simulate",
    "simulate_many",
]
