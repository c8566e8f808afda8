"""What a law's methods answer, looked at before anything is made of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from phcontrol._validation import Array, described, has_finite_square
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import AnswerError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import Measured


def stored(law: Controller, t: float, x: MechanicalState, state: Array, measured: Measured) -> float:
    """Return what a law states as H_d [J]. Raises AnswerError unless it is one finite real number."""
    value: Any = law.storage(t, x, state, measured)
    if (
        np.ndim(value)
        or not isinstance(value, (float, int, np.number))
        or isinstance(value, (complex, np.complexfloating))
    ):
        raise AnswerError(type(law), "storage", f"returned {described(value)}, expected a number [J]")
    if not math.isfinite(value):
        raise AnswerError(type(law), "storage", f"returned {value}, expected a finite number [J], {_where(t, x)}")
    return float(value)


def commanded(law: Controller, t: float, x: MechanicalState, state: Array, measured: Measured) -> Command:
    """Return what a law orders. Raises AnswerError unless torque and state rate are finite vectors of their lengths."""
    command: Any = law.evaluate(t, x, state, measured)
    if not isinstance(command, Command):
        raise AnswerError(type(law), "evaluate", f"returned {described(command)}, expected a Command")
    for name, value, size in (
        ("torque", command.torque, x.system.n),
        ("state_rate", command.state_rate, law.state_size),
    ):
        check_vector(law, "evaluate", value, size, f" as {name}")
        if not has_finite_square(value) and not np.isfinite(value).all():
            problem = f"returned a {name} that is not finite, {np.array2string(value, precision=3)}, {_where(t, x)}"
            raise AnswerError(type(law), "evaluate", problem)
    return command


def check_vector(law: Controller, method: str, value: Any, size: int | None, what: str = "") -> None:
    """Raise AnswerError unless what a method returned is an array of real numbers, of one dimension and a length."""
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiu" and size in (None, len(value)):
        return
    expected = "an array of one dimension" if size is None else f"an array of shape ({size},)"
    raise AnswerError(type(law), method, f"returned {described(value)}{what}, expected {expected}")


def _where(t: float, x: MechanicalState) -> str:
    moving = f"q̇ = {np.array2string(x.velocity, precision=3)}" if x.velocity.any() else "q̇ = 0"
    return f"at t = {t:.4g} s, q = {np.array2string(x.position, precision=3)}, {moving}"
