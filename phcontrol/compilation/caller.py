"""How compiled laws are called: in C where that was built with the package, else by ctypes."""

from __future__ import annotations

from typing import Any

CALLER = "C"
"""Which one is in use: "C" or "ctypes"."""

Caller: Any
try:
    from phcontrol.compilation._caller import Caller
except ImportError:
    from phcontrol.compilation._plain_caller import Caller

    CALLER = "ctypes"
