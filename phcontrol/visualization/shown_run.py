"""A run as a page shows it."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array
from phcontrol.visualization.stage import Stage


class ShownRun(NamedTuple):
    """What stands in it, and its frames."""

    stage: Stage
    frames: Array
    """Shape (N, columns), as ``Stage.frame`` gives them."""
    name: str = ""
    """What it is called beside others."""
