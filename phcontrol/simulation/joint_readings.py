"""A joint sensor as a loop in C has it: numbers alone, its noise drawn beforehand."""

from __future__ import annotations

import math

import numpy as np

from phcontrol._validation import Array
from phcontrol.sensors.joint_sensor import JointSensor

_ROUNDING = 1e-9  # of times, as in the sensor itself [s]


def joint_readings(sensor: JointSensor, n: int, steps: int, dt: float) -> Array:
    """Return a joint sensor as numbers, as ``read_joints`` in C reads them.

    The noise is that which the sensor would draw, one reading after another.

    Args:
        sensor: the sensor.
        n: joints.
        steps: of the run.
        dt: of a step [s].
    """
    faults, readings = sensor.faults(n), steps + 1
    late = min(max(0, math.ceil((sensor.delay - _ROUNDING) / dt)), readings)  # beyond, only the first is shown
    noisy = bool(faults.noise.any())
    noise = faults.noise * sensor.noise_source().standard_normal((readings, 2 * n)) if noisy else np.zeros(0)
    on_its_way = np.zeros((late + 1) * 2 * n)
    return np.concatenate([[float(late), float(noisy)], faults.bias, faults.resolution, on_its_way, noise.ravel()])
