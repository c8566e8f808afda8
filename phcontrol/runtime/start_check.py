"""Whether a control loop may start from where the arm is."""

from __future__ import annotations

import warnings

from phcontrol._validation import Array, choice
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.runtime.safe_starts import SafeStarts

UNSAFE_START = ("refuse", "warn")


class StartCheck:
    """Refuses, or warns of, starts outside a law's safe set.

    Args:
        safe_set: of the law; None asks nothing.
        controller: the law.
        unsafe_start: "refuse" or "warn".
    """

    def __init__(self, safe_set: SafeStarts | None, controller: Controller, unsafe_start: str) -> None:
        if safe_set is not None and getattr(safe_set, "controller", None) is not controller:
            raise InvalidArgumentError("safe_set", "must be the safe_set() of this very law")
        self._safe_set = safe_set
        self._warns = choice("unsafe_start", unsafe_start, UNSAFE_START) == "warn"

    def check(self, x: MechanicalState, state: Array) -> None:
        """Raise PHControlError, or warn, where a state of the arm and of the law is outside the set."""
        safe = self._safe_set
        if safe is None:
            return
        margin = safe.margin(x.position, x.velocity, state)
        if margin >= 0.0:
            return
        message = (
            f"a start with a storage function of {safe.level - margin:.4g} J, and safe ones have at most "
            f"{safe.level:.4g} J: the {safe.binding} may be passed"
        )
        if not self._warns:
            raise PHControlError(message)
        warnings.warn(message, stacklevel=6)
