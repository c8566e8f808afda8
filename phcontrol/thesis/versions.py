"""What the numbers of a reproduction depend on beside its code."""

from __future__ import annotations

import platform

import numpy as np
import pinocchio as pin
import scipy

from phcontrol._version import __version__


def versions() -> dict[str, str]:
    """Return the versions that numbers depend on."""
    return {
        "phcontrol": __version__,
        "pinocchio": pin.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }
