"""Many runs: what varies, what is measured, and who simulates."""

# Written by python -m phcontrol._groups.

from .sweeps.dask_scheduler import DaskScheduler
from .sweeps.engine import Engine
from .sweeps.local_processes import LocalProcesses
from .sweeps.statement import Statement
from .sweeps.sweep import Sweep
from .sweeps.sweep_results import SweepResults

__all__ = [
    "DaskScheduler",
    "Engine",
    "LocalProcesses",
    "Statement",
    "Sweep",
    "SweepResults",
]
