"""Where a trajectory asks for more than an arm can do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phcontrol._validation import Array, count, positive
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.trajectories.trajectory import Trajectory, check_trajectory

ROUNDING = 1e-9
"""How far beyond a limit still counts as on it, relative to the limit (or to 1)."""


@dataclass(frozen=True)
class JointPeak:
    """The largest demand on one joint, beside its limit."""

    quantity: str
    """"position", "velocity" or "torque"."""
    joint: str
    value: float
    """The value nearest to (or furthest beyond) a limit, with its sign."""
    limit: float
    """The limit that it comes nearest to, with its sign."""
    time: float
    """When [s]."""
    broken: tuple[tuple[float, float], ...]
    """From when to when the limit is broken [s]; empty when it is kept."""


@dataclass(frozen=True)
class LimitReport:
    """What a trajectory asks of each joint, and where it breaks a limit.

    Example:
        >>> from phcontrol import MechanicalSystem, MinimumJerk, check_limits, load_robot
        >>> robot = load_robot("pera_shoulder")
        >>> way = MinimumJerk([0.0, 0.0], [1.0, 0.5], travel_time=0.1)  # too fast
        >>> report = check_limits(way, MechanicalSystem(robot))
        >>> report.kept, "velocity" in {peak.quantity for peak in report.violations}
        (False, True)
    """

    peaks: tuple[JointPeak, ...]

    @property
    def kept(self) -> bool:
        """Whether no limit is broken at any sample."""
        return not self.violations

    @property
    def violations(self) -> tuple[JointPeak, ...]:
        """The peaks beyond their limits."""
        return tuple(peak for peak in self.peaks if peak.broken)

    def __str__(self) -> str:
        if self.kept:
            return "limits: position, velocity and torque kept"
        units = {"position": "rad", "velocity": "rad/s", "torque": "N·m"}
        lines = [
            f"  {peak.quantity} of {peak.joint}: {peak.value:.3g} {units[peak.quantity]} at {peak.time:.3g} s, limit "
            f"{peak.limit:.3g}; broken " + ", ".join(f"{a:.3g} to {b:.3g} s" for a, b in peak.broken)
            for peak in self.violations
        ]
        return "\n".join(["limits: BROKEN", *lines])


def check_limits(
    trajectory: Trajectory, system: MechanicalSystem, *, duration: float | None = None, samples: int = 1001
) -> LimitReport:
    """Compare a trajectory with the robot's position, velocity and torque limits at even times.

    The torque is that of inverse dynamics, u = G⁻¹(M q̈_d + C q̇_d + D q̇_d + ∂V/∂q): what following it
    exactly takes, without any error to correct and without external forces. Where joints have no limit nothing
    is reported. What happens between two samples is not seen.

    Args:
        trajectory: q_d(t).
        system: the arm.
        duration: how long it is followed from 0 [s]; by default the trajectory's own duration.
        samples: how many instants.

    Example:
        >>> from phcontrol import MechanicalSystem, MinimumJerk, check_limits, load_robot
        >>> robot = load_robot("pera_shoulder")
        >>> slow = MinimumJerk.within_limits(robot, [0.0, 0.0], [1.0, 0.5])
        >>> check_limits(slow, MechanicalSystem(robot)).kept
        True
    """
    check_trajectory("trajectory", trajectory, system.n)
    end = trajectory.duration if duration is None else positive("duration", duration)
    times = np.linspace(0.0, end, count("samples", samples, minimum=2))
    rows = [trajectory.at(float(t)) for t in times]
    position, velocity = np.array([row.position for row in rows]), np.array([row.velocity for row in rows])
    torque = np.array([_torque(system, *row) for row in rows])
    return check_samples(system.robot, times, position, velocity, torque)


def check_samples(
    robot: Robot, times: Array, position: Array, velocity: Array, torque: Array, *, rounding: float = ROUNDING
) -> LimitReport:
    """Compare samples of a motion with the robot's position, velocity and torque limits.

    Args:
        robot: the arm.
        times: of the samples, shape (N,) [s].
        position: shape (N, n) [rad].
        velocity: shape (N, n) [rad/s].
        torque: shape (N, n) [N·m].
        rounding: how far beyond a limit still counts as on it, relative to the limit (or to 1).
    """
    peaks = [
        *_peaks(robot, "position", times, position, robot.lower, robot.upper, rounding),
        *_peaks(robot, "velocity", times, velocity, -robot.velocity_limit, robot.velocity_limit, rounding),
        *_peaks(robot, "torque", times, torque, -robot.effort_limit, robot.effort_limit, rounding),
    ]
    return LimitReport(tuple(peaks))


def _torque(system: MechanicalSystem, position: Array, velocity: Array, acceleration: Array) -> Array:
    """Return the torque of inverse dynamics [N·m]."""
    x = system.at(position, velocity)
    return x.motor_torque(x.feedforward(velocity, acceleration))


def _peaks(
    robot: Robot, quantity: str, times: Array, values: Array, lower: Array, upper: Array, rounding: float
) -> list[JointPeak]:
    peaks = []
    for joint, column, low, high in zip(robot.joint_names, values.T, lower, upper, strict=True):
        if np.isinf(low) and np.isinf(high):
            continue
        excess = np.maximum(column - high, low - column)
        worst = int(np.argmax(excess))
        limit = high if column[worst] - high >= low - column[worst] else low
        beyond = excess > rounding * max(1.0, abs(limit))
        peaks.append(
            JointPeak(
                quantity, joint, float(column[worst]), float(limit), float(times[worst]), _intervals(times, beyond)
            )
        )
    return peaks


def _intervals(times: Array, inside: Array) -> tuple[tuple[float, float], ...]:
    """Return the first and last instants of each run of True."""
    edges = np.diff(np.concatenate([[0], inside.astype(int), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return tuple((float(times[a]), float(times[b])) for a, b in zip(begins, ends, strict=True))
