"""How compiled laws are called: in C where that was built with the package, else by ctypes."""

from __future__ import annotations

from typing import TYPE_CHECKING

__all__ = ["CALLER", "Caller"]

if TYPE_CHECKING:
    from phcontrol.compilation._plain_caller import Caller
else:
    try:
        from phcontrol.compilation._caller import Caller
    except ImportError:
        from phcontrol.compilation._plain_caller import Caller

CALLER = "ctypes" if Caller.__module__.endswith("_plain_caller") else "C"
"""Which one is in use: "C" or "ctypes"."""
