"""What the page can plot of a run: every signal with its name, unit, colour and limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.robot import Robot
from phcontrol.visualization.colors import COLORS


@dataclass(frozen=True)
class Signal:
    """A signal of a run, one number a frame."""

    group: str
    """The chart that it belongs to."""
    label: str
    unit: str
    color: str
    limits: tuple[float | None, float | None] | None = None
    """Lower and upper limit of the arm; None for none."""
    floats: bool = False
    """Whether its zero means nothing, and need not be on the axis."""

    def to_dict(self) -> dict[str, Any]:
        """Return it for the page."""
        return asdict(self)


ENERGIES = (
    Signal("storage function", "storage function H_d", "J", "#0072b2"),
    Signal("energy of the arm", "energy H of the arm", "J", "#d55e00", floats=True),
    Signal("power", "dissipated by the loop", "W", "#009e73"),
    Signal("power", "supplied from outside", "W", "#cc79a7"),
    Signal("power", "given by the motors", "W", "#7f7f7f"),
)
TANK = Signal("storage function", "energy in the tank", "J", "#e69f00")
HAND = (
    Signal("hand to its goal", "distance", "m", "#0072b2"),
    Signal("hand to its goal", "angle", "rad", "#d55e00"),
)


def contact_signal(unit: str) -> Signal:
    """Return the force of the touched bodies."""
    return Signal("contact", "contact force", unit, "#b01515")


def joint_signals(robot: Robot, goal: bool) -> list[Signal]:
    """Return positions, velocities, torques and external forces of the joints; errors where there is a goal."""
    slides = [bool(robot.prismatic[k]) if len(robot.prismatic) else False for k in range(robot.n)]
    unbounded = [(None, None)] * robot.n
    groups: list[tuple[str, tuple[str, str], Sequence[tuple[float | None, float | None]]]] = [
        ("position", ("rad", "m"), _pairs(robot.lower, robot.upper)),
        ("velocity", ("rad/s", "m/s"), _pairs(-robot.velocity_limit, robot.velocity_limit)),
        ("torque", ("N·m", "N"), _pairs(-robot.effort_limit, robot.effort_limit)),
        ("external force", ("N·m", "N"), unbounded),
        *([("joint error", ("rad", "m"), unbounded)] if goal else []),
    ]
    return [
        Signal(group, name, units[slides[k]], COLORS[k % len(COLORS)], None if limits[k] == (None, None) else limits[k])
        for group, units, limits in groups
        for k, name in enumerate(robot.joint_names)
    ]


def joint_values(robot: Robot, position: Array, row: Mapping[str, Any], goal: bool) -> list[float]:
    """Return the values of ``joint_signals`` at one sample."""
    values = [*position, *row["velocity"], *row["torque"], *row["external_force"]]
    if goal:
        values += list(robot.difference(np.asarray(position), np.asarray(row["goal"])))
    return values


def _pairs(lower: Array, upper: Array) -> list[tuple[float | None, float | None]]:
    return [(_finite(low), _finite(high)) for low, high in zip(lower, upper, strict=True)]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
