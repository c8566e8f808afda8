"""Measured motions: what an identification looks at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.simulation.log import Log

_LARGEST = 1e6  # of a position, velocity or torque [rad, rad/s, N·m]
_UNEVEN = 1e-3  # part of a period by which samples may be off


@dataclass(frozen=True)
class Motion:
    """Samples of an arm's motion at equal distances of time; of a log, or of measurements (:meth:`of`).

    Example:
        >>> import numpy as np
        >>> from phcontrol import Motion
        >>> t = np.linspace(0.0, 1.0, 101)
        >>> motion = Motion.of(t, *np.zeros((3, 101, 2)))  # q, q̇ and torques of two joints
        >>> motion.period, motion.held
        (0.01, True)
    """

    time: Array
    """Shape (N,) [s]."""
    position: Array
    """q, shape (N, n) [rad]."""
    velocity: Array
    """q̇, shape (N, n) [rad/s]."""
    torque: Array
    """G u + f_e: what acts on the joints beside weight and friction, shape (N, n) [N·m]."""
    held: bool
    """Whether each torque was held until the next sample; else it is that of the instant."""

    @property
    def period(self) -> float:
        """Distance of the samples [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @classmethod
    def of(
        cls, time: ArrayLike, position: ArrayLike, velocity: ArrayLike, torque: ArrayLike, *, held: bool = True
    ) -> Motion:
        """Return a motion of measurements, checked: finite, of one length, at equal distances of time.

        >>> import numpy as np
        >>> t = np.linspace(0.0, 1.0, 101)
        >>> Motion.of(t, *np.zeros((3, 101, 2))).period
        0.01
        """
        times = finite_array("time", time)
        if times.ndim != 1 or len(times) < 3:
            raise InvalidArgumentError(
                "time", f"must hold the times of at least 3 samples, but has shape {times.shape}"
            )
        steps = np.diff(times)
        if (steps <= 0.0).any() or np.ptp(steps) > _UNEVEN * steps.mean():
            raise InvalidArgumentError(
                "time",
                f"must grow in equal steps, but they are {steps.min():g} to {steps.max():g} s: samples are missing",
            )
        q, v, u = finite_array("position", position), finite_array("velocity", velocity), finite_array("torque", torque)
        shape = (len(times), q.shape[-1] if q.ndim else 0)
        for name, array in (("position", q), ("velocity", v), ("torque", u)):
            if array.shape != shape:
                raise InvalidArgumentError(name, f"must have shape {shape}, a row a sample, but has {array.shape}")
            largest = float(np.abs(array).max(initial=0.0))
            if largest > _LARGEST:
                raise InvalidArgumentError(name, f"has an entry of {largest:.2g}, which no arm's is")
        return cls(times, q, v, u, held)


def motions_of(logs: Log | Motion | Sequence[Log | Motion], input_matrix: Array | None) -> list[Motion]:
    """Return the motions of logs of an arm with this G. Raises InvalidArgumentError for anything else."""
    items = [logs] if isinstance(logs, (Log, Motion)) else logs
    if not isinstance(items, (list, tuple)) or not items:
        raise InvalidArgumentError("logs", f"must be a Log, a Motion or a list of them, but is {type(logs).__name__}")
    return [_motion(item, input_matrix) for item in items]


def _motion(item: object, input_matrix: Array | None) -> Motion:
    if isinstance(item, Motion):
        return item
    if not isinstance(item, Log):
        raise InvalidArgumentError("logs", f"must hold logs and motions, but one is {type(item).__name__}")
    torque = item.torque if input_matrix is None else item.torque @ input_matrix.T
    held = item.metadata.get("control_period") is not None
    return Motion.of(item.time, item.position, item.velocity, torque + item.external_force, held=held)
