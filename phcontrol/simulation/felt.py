"""A force sensor as a loop in C has it: numbers alone, its noise drawn beforehand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.simulation.instruments import due_of

_ROUNDING = 1e-9  # of times, as in the sensor itself [s]


def is_felt(sensor: Any, n: int) -> bool:
    """Return whether a sensor is a force sensor that there is in C: of f_e at the joints, with numbers that fit."""
    if type(sensor) is not ForceSensor or sensor.frame is not None or sensor.quantity != "external_force":
        return False
    given = (sensor.noise, sensor.bias, sensor.saturation)
    return all(value is None or value.shape in ((), (n,)) for value in given)


def felt_by(sensor: Any, n: int, steps: int, dt: float) -> Array | None:
    """Return a force sensor as numbers, as ``sense`` in C reads them; None for another sensor.

    The noise is that which the sensor would draw, one update after another.

    Args:
        sensor: the sensor.
        n: joints.
        steps: of the run.
        dt: of a step [s].
    """
    if not is_felt(sensor, n):
        return None
    every = due_of([sensor], dt)
    late = max(0, math.ceil((sensor.delay - _ROUNDING) / (every * dt)))
    updates, noisy = steps // every + 1, bool(sensor.noise.any())
    late = min(late, updates)  # none is shown in this run
    most = np.inf if sensor.saturation is None else sensor.saturation
    noise = sensor.noise * np.random.default_rng(sensor.seed).standard_normal((updates, n)) if noisy else np.zeros(0)
    parts = [[float(every), float(late), float(noisy)], np.broadcast_to(sensor.bias, n), np.broadcast_to(most, n)]
    return np.concatenate([*parts, np.zeros((late + 1) * n), noise.ravel()])
