"""The borders of what is measured beside positions and velocities."""

from __future__ import annotations

from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.robot import Robot
from phcontrol.runtime.signal_border import SignalBorder
from phcontrol.sensors.measured import Measured, check_needs

_LARGEST_FORCE = 5.0  # that is believed at all, relative to the effort limits


class MeasuredBorders:
    """A :class:`SignalBorder` for each field of :class:`Measured`, and what a law can go by.

    Forces are not believed beyond five times the effort limits, and a change of more than the effort limits from one
    value to the next only if it stays. Features may be NaN (nothing seen); one that is seen does not move by more than
    the focal length (45 degrees) from one value to the next. What is not measured is None; where the law needs it,
    and had it before, that is a value that makes no sense.

    Args:
        controller: the law.
        robot: its arm.
    """

    def __init__(self, controller: Controller, robot: Robot) -> None:
        check_needs(type(controller).__name__, controller.needs)
        self._needs = frozenset(controller.needs)
        effort, image = np.array(robot.effort_limit), _image_scale(controller)

        def force_jumps(force: Array, last: Array, elapsed: float) -> bool:
            return bool((np.abs(force - last) > effort).any())

        def features_jump(features: Array, last: Array, elapsed: float) -> bool:
            return bool((np.abs(features - last) > image).any())  # never where one is NaN

        largest, anything = _LARGEST_FORCE * effort, np.full(3, np.inf)
        self._borders = {
            "external_force": SignalBorder(-largest, largest, force_jumps),
            "total_force": SignalBorder(-largest, largest, force_jumps),
            "features": SignalBorder(-anything, anything, features_jump, may_be_nan=True),
        }

    def elapse(self, seconds: float) -> None:
        """Let time pass."""
        for border in self._borders.values():
            border.elapse(seconds)

    def offer(self, measured: Any, age: float) -> int:
        """Take over what makes sense of a measurement of an age [s]; return how many values of it do not."""
        implausible = 0
        for name, border in self._borders.items():
            value = getattr(measured, name) if isinstance(measured, Measured) else "no Measured"
            if value is None and not (name in self._needs and border.value is not None):
                border.forget()
            elif not border.offer(value, age):
                implausible += 1
        return implausible

    def seen(self, oldest: float) -> Measured:
        """Return what is believed, none of it older than ``oldest`` [s]."""
        return Measured(**{name: border.current(oldest) for name, border in self._borders.items()})

    def missing(self, oldest: float) -> str:
        """Return in words what the law needs, and was offered before, but is not believed now; empty if nothing."""
        for name in self._needs & self._borders.keys():
            border = self._borders[name]
            if border.current(oldest) is None and (border.rejected_in_a_row or border.value is not None):
                if border.rejected_in_a_row:
                    return f"{border.rejected_in_a_row} values of {name} in a row do not make sense"
                return f"no {name} for {border.age:g} s"
        return ""


def _image_scale(controller: Controller) -> float:
    """Return the focal length of the camera that a law, or one of its laws, steers by [m]; infinite without one."""
    return np.inf if controller.eyes is None else controller.eyes.camera.focal_length
