"""Whether the signals of a motion agree with each other: velocity with position, and both in time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.identification.motion import Motion
from phcontrol.mechanics.robot import Robot

LATE = 0.75
"""Periods by which signals may be apart: a half is between the samples of many simulators, and no more than that."""
_SHORTEST = 4  # periods that a window must have
_PART = 0.05  # of a joint's way in a window, by which the integral of its velocity may be off
_SLOW = 0.01  # a speed at which a joint stands still all the same [rad/s, m/s]
_CLEARER = 1.5  # times that a shift in time must bring velocity and position closer, to be believed
_FARTHEST = 0.25  # shifts that are looked at [s]
_MEANT = {1e-3: "times in ms?", 1e3: "times in thousands of seconds?", np.pi / 180.0: "velocity in degrees a second?",
          180.0 / np.pi: "position in degrees?", -1.0: "a sign"}  # fmt: skip


class _Ways(NamedTuple):
    """How far joints went in windows, by their positions and by their velocities."""

    by_position: Array
    by_velocity: Array

    @property
    def apart(self) -> Array:
        """Root mean square of the difference, of each joint."""
        apart: Array = np.sqrt(np.mean((self.by_position - self.by_velocity) ** 2, axis=0))
        return apart


def check_agreement(robot: Robot, motion: Motion, window: float) -> None:
    """Raise InvalidArgumentError where a motion contradicts itself; over windows [s] noise averages out.

    Checked are that windows have samples enough, that the ways of the joints are the integrals of their velocities, and
    that both are of the same instants: the shift at which their cross correlation is largest is the delay.
    """
    length = round(window / motion.period)
    if length < _SHORTEST:
        raise InvalidArgumentError(
            "window",
            f"of {window:g} s has no {_SHORTEST} samples, which are {motion.period:g} s apart: times must be in "
            "seconds, and a window longer than that",
        )
    steps = robot.difference(motion.position[1:], motion.position[:-1])
    speeds = 0.5 * (motion.velocity[1:] + motion.velocity[:-1])
    ways = _ways(steps, speeds, motion.period, length, 0.0)
    still = _SLOW * length * motion.period
    moves = np.maximum(*(np.sqrt(np.mean(way**2, axis=0)) for way in ways)) > still if len(ways.by_position) else []
    if not np.any(moves):
        return
    steps, speeds = steps[:, moves], speeds[:, moves]
    late = _delay(steps, speeds, round(min(_FARTHEST / motion.period, 0.25 * len(steps))))
    shifted, plain = (_ways(steps, speeds, motion.period, length, shift) for shift in (late, 0.0))
    names = [name for name, does in zip(robot.joint_names, moves, strict=True) if does]
    allowed = still + _PART * np.sqrt(np.mean(shifted.by_position**2, axis=0))
    wrong = shifted.apart > allowed
    if wrong.any():
        raise InvalidArgumentError("logs", _contradiction(shifted, wrong, names))
    if abs(late) > LATE and np.linalg.norm(plain.apart) > _CLEARER * np.linalg.norm(shifted.apart):
        raise InvalidArgumentError(
            "logs",
            f"have velocities that are {said_delay(late, motion.period)} against the positions: shift them, or "
            "differentiate the positions",
        )


def said_delay(periods: float, period: float) -> str:
    """Return a delay in words."""
    word = "late" if periods > 0.0 else "early"
    return f"{word} by {abs(periods) * period:.2g} s ({abs(periods):.1f} periods)"


def _ways(steps: Array, speeds: Array, period: float, length: int, late: float) -> _Ways:
    """Return the ways of the joints in windows of ``length`` steps; velocities ``late`` periods late are moved back."""
    edges = np.arange(len(steps) + 1.0)
    first, last = max(0.0, -late), len(steps) - max(0.0, late)
    places = np.arange(np.ceil(first), last + 1e-9, length)
    position = np.vstack([np.zeros(steps.shape[1]), np.cumsum(steps, axis=0)])[places.astype(int)]
    integral = np.vstack([np.zeros(steps.shape[1]), period * np.cumsum(speeds, axis=0)])
    moved = [np.interp(places + late, edges, column) for column in integral.T]
    return _Ways(np.diff(position, axis=0), np.diff(np.array(moved).T, axis=0))


def _delay(steps: Array, speeds: Array, farthest: int) -> float:
    """Return by how many periods speeds are late: where the cross correlation with the steps is largest."""
    size = len(steps)
    scale = np.linalg.norm(steps, axis=0) * np.linalg.norm(speeds, axis=0)
    scale = np.where(scale > 0.0, scale, np.inf)
    shifts = range(-farthest, farthest + 1)
    correlation = []
    for k in shifts:
        here, there = slice(max(0, -k), size - max(0, k)), slice(max(0, k), size - max(0, -k))
        correlation.append(float(np.abs(np.sum(steps[here] * speeds[there], axis=0) / scale).sum()))
    best = int(np.argmax(correlation))
    if best in (0, len(shifts) - 1):
        return float(shifts[best])
    before, peak, after = correlation[best - 1 : best + 2]
    curvature = before - 2.0 * peak + after
    return float(shifts[best] + (0.5 * (before - after) / curvature if curvature < 0.0 else 0.0))


def _contradiction(ways: _Ways, wrong: Array, names: list[str]) -> str:
    factor = np.sum(ways.by_position * ways.by_velocity, axis=0) / np.sum(ways.by_velocity**2, axis=0).clip(1e-300)
    found = []
    for name, is_wrong, times in zip(names, wrong, factor, strict=True):
        if is_wrong:
            guess = next((f", {word}" for value, word in _MEANT.items() if abs(times / value - 1.0) < 0.05), "")
            found.append(f"{name} (it goes {times:.3g} times as far as its velocity says{guess})")
    return f"contradict themselves: the velocity is not the derivative of the position of {'; '.join(found)}"
