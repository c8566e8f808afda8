"""Numbers read off a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phcontrol._validation import Array
from phcontrol.simulation.log import Log
from phcontrol.trajectories.trajectory import Trajectory


def touch_time(log: Log) -> float:
    """Return when contact begins [s]; infinite if never."""
    rows = np.flatnonzero(log.contact_force > 0.0)
    return float(log.time[rows[0]]) if rows.size else float("inf")


def impact_force(log: Log, within: float = 0.5) -> float:
    """Return the largest contact force within a time of first contact [N, or N·m for a joint]; 0 without contact."""
    begins = touch_time(log)
    return float(log.contact_force[log.time <= begins + within].max()) if np.isfinite(begins) else 0.0


def settling_time(log: Log, force: float, within: float = 0.05) -> float:
    """Return from when the contact force stays within a fraction of a desired one [s]; infinite if never."""
    return _stays_from(log, np.abs(log.contact_force - force) <= within * force)


def feature_settling_time(log: Log, goal: Array, within: float) -> float:
    """Return from when every image feature stays within a distance [m] of its goal [s]; infinite if never."""
    return _stays_from(log, np.abs(log.features - goal).max(axis=1) <= within)


def _stays_from(log: Log, inside: NDArray[np.bool_]) -> float:
    """Return from when a condition holds to the end [s]; infinite if it does not hold at the end."""
    outside = np.flatnonzero(~inside)
    if outside.size == 0:
        return 0.0
    return float(log.time[outside[-1] + 1]) if outside[-1] + 1 < len(log) else float("inf")


def tracking_error(log: Log, trajectory: Trajectory) -> Array:
    """Return q − q_d at every sample, shape (N, n) [rad]."""
    error: Array = log.position - np.array([trajectory.at(float(t)).position for t in log.time])
    return error
