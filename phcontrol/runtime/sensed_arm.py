"""An arm with a force sensor in its wrist."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.runtime.arm_driver import ArmDriver, Reading
from phcontrol.sensors.wrist_sensor import WristSensor


class SensedArm:
    """A driver that measures the external force by a sensor in the wrist, and is otherwise the driver it is given.

        with FrankaArm(address, system) as franka:
            sensor = WristSensor(system, "fr3_link8", Tool(0.7, [0, 0, 0.05])).tare(franka.read().position, read())
            drive(loop, SensedArm(franka, sensor, read), 10.0)

    Args:
        arm: the driver of the arm.
        sensor: with its offset and tool.
        read: returns the sensor's newest reading, shape (6,) [N, N·m], without waiting; None where there is none: then
            the force counts as not measured.

    Example:
        >>> from phcontrol import ControlBox, MechanicalSystem, SensedArm, SimulatedArm, WristSensor, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> sensor = WristSensor(system, "tool")
        >>> read = lambda: [0.0, 0.0, -2.0, 0.0, 0.0, 0.0]  # [N], [N·m]: what your sensor's program returns
        >>> arm = SensedArm(SimulatedArm(ControlBox(system)), sensor, read)
        >>> arm.read().measured.external_force.shape
        (7,)
    """

    def __init__(self, arm: ArmDriver, sensor: WristSensor, read: Callable[[], ArrayLike | None]) -> None:
        if not callable(read):
            raise InvalidArgumentError("read", f"must be a function, but is {type(read).__name__}")
        self.arm, self.sensor, self._read = arm, sensor, read
        self.gravity, self.pace = arm.gravity, arm.pace

    def read(self) -> Reading | None:
        """Return the arm's reading with the sensor's force in it."""
        reading, wrench = self.arm.read(), self._read()
        if reading is None:
            return None
        force = None
        if wrench is not None:
            force = self.sensor.external_force(self.sensor.system.at(reading.position), wrench)
        return reading._replace(measured=reading.measured._replace(external_force=force))

    def write(self, torque: Array) -> None:
        """Send a torque to the arm."""
        self.arm.write(torque)
