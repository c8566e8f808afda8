"""The sensors of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from phcontrol._validation import Array, whole_multiple
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.joint_sensor import JointSensor
from phcontrol.sensors.measured import Measured
from phcontrol.sensors.sensor import Sensor
from phcontrol.simulation.vector_field import ClosedLoop, Held


def due_of(sensors: Sequence[Sensor] | None, dt: float) -> int:
    """Return the steps between two updates of the first sensor; 1 without one."""
    period = sensors[0].period if sensors else None
    return 1 if period is None else whole_multiple("period", period, dt)


class Instruments:
    """The sensors of a run and their states."""

    def __init__(self, sensors: Sequence[Sensor], dt: float) -> None:
        self.sensors = list(sensors)
        quantities = [sensor.quantity for sensor in self.sensors]
        if len(set(quantities)) != len(quantities):
            raise InvalidArgumentError("sensors", f"must not have two for the same quantity, but has {quantities}")
        self._strides = [
            1 if sensor.period is None else whole_multiple("period", sensor.period, dt) for sensor in self.sensors
        ]
        self._states: list[Any] = []
        self._torques: list[Array] = []
        self._last_torque: Array | None = None

    def observe(
        self, k: int, t: float, loop: ClosedLoop, y: Array, held: Held, seen: MechanicalState | None = None
    ) -> Measured:
        """Update the sensors that are due at step k and return what all show; ``held`` was so in the step that ends.

        ``seen`` is the plant's state as a joint sensor shows it; None for the truth.
        """
        x = loop.plant_state(y)
        external_force = loop.surroundings(t, x, y).external_force
        given = [x if seen is None or not getattr(sensor, "reads_joints", False) else seen for sensor in self.sensors]
        if k == 0:
            self._states = [
                sensor.start(view, external_force) for sensor, view in zip(self.sensors, given, strict=True)
            ]
            self._torques = [np.zeros(loop.n) for _ in self.sensors]
        elif self._last_torque is not None:
            # a continuous controller's torque changes during a step: its mean over the step
            applied = 0.5 * (self._last_torque + loop.torque(t, y, held))
            self._torques = [torque + applied for torque in self._torques]
        readings: dict[str, Array] = {}
        for i, (sensor, stride) in enumerate(zip(self.sensors, self._strides, strict=True)):
            if k % stride == 0:
                mean_torque = self._torques[i] / stride
                self._states[i] = sensor.update(self._states[i], t, given[i], external_force, mean_torque)
                self._torques[i] = np.zeros(loop.n)
            readings[sensor.quantity] = sensor.reading(self._states[i])
        return Measured(**readings)

    def applied(self, torque: Array) -> None:
        """Note the torque at the start of a step."""
        self._last_torque = torque


class Encoders:
    """The joint sensor of a run and its state."""

    def __init__(self, sensor: JointSensor) -> None:
        self._sensor = sensor
        self._state: Any = None

    def observe(self, t: float, x: MechanicalState) -> MechanicalState:
        """Take a reading of the plant's state and return that state as it is shown."""
        if self._state is None:
            self._state = self._sensor.start(x.position, x.velocity)
        self._state = self._sensor.update(self._state, t, x.position, x.velocity)
        return x.system.state_type(x.system, *self._sensor.reading(self._state))
