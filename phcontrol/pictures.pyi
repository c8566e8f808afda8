"""Plots and pages of runs."""

# Written by python -m phcontrol._groups.

from .visualization.live import LiveView
from .visualization.log_plots import LogPlots, compare
from .visualization.recording import record

__all__ = [
    "LiveView",
    "LogPlots",
    "compare",
    "record",
]
