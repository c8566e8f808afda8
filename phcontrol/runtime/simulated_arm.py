"""An arm in this process, behind a network that need not be perfect."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array, instance
from phcontrol.runtime.arm_driver import Pace, Reading
from phcontrol.runtime.control_box import ControlBox
from phcontrol.runtime.control_loop import Gravity
from phcontrol.runtime.packet_faults import PacketFaults


class SimulatedArm:
    """A driver whose arm is a :class:`ControlBox` in this process: each ``write`` lets one period pass.

    It adds its weight itself where the box does. Time is the box's: a loop that drives it gets
    ``clock=lambda: box.time``, or it takes a slow computer for gaps.

    Args:
        box: the arm.
        readings: what happens to readings on their way; nothing by default.
        commands: what happens to torques on their way.

    Example:
        >>> from phcontrol import ControlBox, MechanicalSystem, SimulatedArm, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> arm = SimulatedArm(ControlBox(system, position=[0.1, 0.0]))
        >>> arm.read().position, arm.gravity, arm.pace
        (array([0.1, 0. ]), 'controller', 'write')
    """

    pace: Pace = "write"

    def __init__(
        self,
        box: ControlBox,
        *,
        readings: PacketFaults[tuple[int, Reading]] | None = None,
        commands: PacketFaults[tuple[int, Array]] | None = None,
    ) -> None:
        self.box = instance("box", box, ControlBox)
        for name, way in (("readings", readings), ("commands", commands)):
            if way is not None:
                instance(name, way, PacketFaults)
        self.gravity: Gravity = box.gravity
        self._readings = PacketFaults() if readings is None else readings
        self._commands = PacketFaults() if commands is None else commands
        self._number = 0
        self._newest, self._newest_number = box.reading(), -1
        self._readings.send(box.time, (0, self._newest))

    def read(self) -> Reading | None:
        """Return the newest reading that has arrived."""
        for number, reading in self._readings.receive(self.box.time):
            if number > self._newest_number:
                self._newest_number, self._newest = number, reading
        if self._newest_number < 0:
            return None
        return self._newest._replace(age=self.box.time - self._newest_number * self.box.period)

    def write(self, torque: Array) -> None:
        """Send a torque, and let one period pass."""
        box = self.box
        self._commands.send(box.time, (self._number, np.array(torque)))  # the caller's may change on the way
        for number, arrived in self._commands.receive(box.time):
            box.command(number, arrived)
        box.advance()
        self._number += 1
        self._readings.send(box.time, (self._number, box.reading()))
