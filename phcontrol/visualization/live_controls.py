"""What may be changed on the page of a run that goes on."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, finite_array, positive
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.setpoints.live_frame_path import LiveFramePath
from phcontrol.setpoints.live_motion import LiveMotion
from phcontrol.setpoints.live_trajectory import LiveTrajectory
from phcontrol.setpoints.live_value import LiveValue
from phcontrol.setpoints.setpoint import Setpoint

TURN = 1.0
"""How far a hand's goal can be turned about each axis of the world [rad]."""


class LiveControls:
    """A slider for each number of a setpoint, and a handle for each hand: what the page asks for is passed on.

    A hand's goal is shown as its place in the world and a rotation vector from its first orientation; a posture by
    its joints; values as they are.

    Args:
        setpoint: whose parts are shown.
        reach: how far a hand's goal can be moved along each axis of the world [m].
        ranges: of values, by the name of the part: lowest and highest; by default a tenth to three times the largest
            of them at first.

    Raises InvalidArgumentError for ranges of what is no value, or that do not hold what it is at first.
    """

    def __init__(
        self, setpoint: Setpoint, *, reach: float = 0.3, ranges: dict[str, tuple[float, float]] | None = None
    ) -> None:
        self.setpoint, self._reach = setpoint, positive("reach", reach)
        self._ranges = {} if ranges is None else ranges
        for name in self._ranges:
            if not isinstance(setpoint.parts.get(name), LiveValue):
                raise InvalidArgumentError("ranges", f"are for values, and '{name}' is none of the setpoint's")
        self._turns: dict[str, Array] = {}
        self.sliders = [slider for name, part in setpoint.parts.items() for slider in self._sliders(name, part)]
        """What the page needs: part, label, unit, lowest, highest and present value of each."""
        self.handles = [name for name, part in setpoint.parts.items() if isinstance(part, LiveFramePath)]
        """Parts that a hand's goal can be dragged for."""
        self.refused = 0
        """How many messages made no sense."""

    def to_dict(self) -> dict[str, Any]:
        """Return what the page needs."""
        return {"sliders": self.sliders, "handles": self.handles}

    def take(self, message: bytes) -> bool:
        """Pass on what a page asks for: {"part": name, "values": numbers of its sliders}. Return whether it did."""
        try:
            asked = json.loads(message)
            name = asked["part"]
            values = finite_array("values", asked["values"])
            self.setpoint.change(**{name: self._goal(name, values)})
        except (PHControlError, ValueError, TypeError, LookupError, RecursionError):
            self.refused += 1
            return False
        return True

    def _goal(self, name: str, values: Array) -> Any:
        part = self.setpoint.parts[name]
        shown = [slider for slider in self.sliders if slider["part"] == name]
        low, high = (np.array([slider[end] for slider in shown]) for end in ("low", "high"))
        if values.shape != low.shape or (values < low).any() or (values > high).any():
            raise InvalidArgumentError("values", f"must be {low.size} numbers from {low} to {high}, but are {values}")
        if isinstance(part, LiveFramePath):
            turn = self._turns.get(name)
            return values if turn is None else (values[:3], pin.exp3(values[3:]) @ turn)
        return values.reshape(np.shape(part.goal)) if isinstance(part, LiveValue) else values

    def _sliders(self, name: str, part: LiveMotion[Any]) -> list[dict[str, Any]]:
        if isinstance(part, LiveFramePath):
            place = part.goal
            found = [
                _slider(name, axis, "m", here - self._reach, here + self._reach, here)
                for axis, here in zip("xyz", place.position, strict=True)
            ]
            if place.rotation is not None:
                self._turns[name] = place.rotation
                found += [_slider(name, f"turn {axis}", "rad", -TURN, TURN, 0.0) for axis in "xyz"]
            return found
        if isinstance(part, LiveTrajectory):
            robot = part.robot
            ends = np.maximum(robot.lower, part.goal - np.pi), np.minimum(robot.upper, part.goal + np.pi)
            units = ["m" if slides else "rad" for slides in robot.prismatic or [False] * robot.n]
            return [
                _slider(name, *each)
                for each in zip(robot.joint_names, units, *ends, part.goal, strict=True)
            ]  # fmt: skip
        assert isinstance(part, LiveValue)
        values = np.ravel(part.goal)
        most = float(np.abs(values).max(initial=0.0))
        usual = min(0.1 * most, float(values.min(initial=most))), max(3.0 * most, 1.0)
        low, high = self._ranges.get(name, usual)
        if not low < high or (values < low).any() or (values > high).any():
            raise InvalidArgumentError("ranges", f"of '{name}' must hold {values}, but are from {low} to {high}")
        return [
            _slider(name, str(k + 1) if values.size > 1 else name, part.unit, low, high, value)
            for k, value in enumerate(values)
        ]


def _slider(part: str, label: str, unit: str, low: float, high: float, value: float) -> dict[str, Any]:
    numbers = {"low": float(low), "high": float(high), "value": float(value)}
    return {"part": part, "label": label, "unit": unit} | numbers
