"""Disturbances as a loop in C has them: a constant force, signals over time as numbers, and what is traced."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.errors import CompilationError
from phcontrol.environments.disturbances import Multiple, Pulse, Sampled, Sine, Step, Sum

_STEP, _PULSE, _SINE, _TABLE = 0.0, 1.0, 2.0, 3.0


class Signals(NamedTuple):
    """A disturbance in three parts, which add up."""

    steady: Array
    """Constant, shape (n,) [N·m]."""
    table: Array
    """Steps, pulses, sines and samples as numbers, as ``signal`` in C reads them; empty for none."""
    traced: tuple[tuple[float, Any], ...]
    """Factors and functions of time and state, which become code."""


def signals_of(disturbance: Any, n: int) -> Signals:
    """Return the parts of a disturbance: None, a force of shape (n,), or a function of time and state."""
    steady: Array = np.zeros(n)
    rows: list[list[float]] = []
    traced: list[tuple[float, Any]] = []

    def take(part: Any, factor: float) -> None:
        kind = type(part)
        if kind is Sum:
            for one in part.parts:
                take(one, factor)
        elif kind is Multiple:
            take(part.part, factor * part.factor)
        elif kind is Step:
            rows.append([_STEP, factor, part.start, 0.0, *_force(part.force, n)])
        elif kind is Pulse:
            rows.append([_PULSE, factor, part.start, part.start + part.duration, *_force(part.force, n)])
        elif kind is Sine:
            rows.append([_SINE, factor, part.rate, part.phase, *_force(part.force, n)])
        elif kind is Sampled:
            samples = [number for force in part.forces for number in _force(force, n)]
            rows.append([_TABLE, factor, float(len(part.times)), float(part.holds), *part.times, *samples])
        else:
            traced.append((factor, part))

    if callable(disturbance):
        take(disturbance, 1.0)
    elif disturbance is not None:
        steady = np.asarray(disturbance, dtype=float)
    table = np.array([float(len(rows)), *(number for row in rows for number in row)]) if rows else np.zeros(0)
    return Signals(steady, table, tuple(traced))


def _force(force: Array, n: int) -> list[float]:
    """Return the entries of a force. Raises CompilationError unless there is one for each joint."""
    if force.shape != (n,):
        raise CompilationError(f"a disturbance has shape {force.shape} for {n} joints")
    return [float(value) for value in force]
