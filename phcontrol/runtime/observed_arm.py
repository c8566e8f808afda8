"""An arm without force sensors, whose external force is told from its motion."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._validation import Array, instance
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.runtime.arm_driver import ArmDriver, Reading
from phcontrol.sensors.momentum_observer import MomentumObserver

_SHORTEST = 1e-5  # between two readings [s]: closer ones are one, read twice


class ObservedArm:
    """A driver that tells the external force by a momentum observer, and is otherwise the driver it is given.

        with FrankaArm(address, system) as franka:
            drive(loop, ObservedArm(franka, MomentumObserver(MechanicalSystem(identified.robot))), 10.0)

    The torque that acted between two readings is the one that the arm says it was sent (``Reading.torque``), or else
    the one last written; where the arm carries its own weight, that is added. Time is the arm's own where it tells
    how much has elapsed, and the clock's minus the reading's age otherwise. Friction and offsets that the observer's
    model does not have are taken for an external force: identify them first (:func:`identify`).

    Args:
        arm: the driver of the arm.
        observer: with the model of the arm, what the hand carries, its friction and offsets included.
        clock: what time is read from where the arm has none [s]: the loop's.

    Example:
        >>> from phcontrol import ControlBox, ControlLoop, MechanicalSystem, MomentumObserver, ObservedArm
        >>> from phcontrol import SimulatedArm, Step, drive, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> box = ControlBox(system, position=[0.0, 0.0], disturbance=Step([1.0, 0.0], 0.0))  # a push [N·m]
        >>> loop = ControlLoop(
        ...     system, make_controller("force_feedback_measured", system), 1e-3, clock=lambda: box.time, deadline=1.0
        ... )
        >>> arm = ObservedArm(SimulatedArm(box), MomentumObserver(system), clock=lambda: box.time)
        >>> drive(loop, arm, 0.5)
        >>> arm.read().measured.external_force.round(2) + 0.0
        array([1., 0.])
    """

    def __init__(
        self, arm: ArmDriver, observer: MomentumObserver, *, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        instance("observer", observer, MomentumObserver)
        if observer.period is not None:
            raise InvalidArgumentError("observer", "has a period of its own: an arm's readings set it, leave it out")
        if not callable(clock):
            raise InvalidArgumentError("clock", f"must be a function, but is {type(clock).__name__}")
        self.arm, self.observer, self._clock = arm, observer, clock
        self.gravity, self.pace = arm.gravity, arm.pace
        self._state: Any = None
        self._time = 0.0  # of the last reading [s]
        self._sent: Array = np.zeros(observer.system.n)
        self._weight: Array = np.zeros(observer.system.n)

    def read(self) -> Reading | None:
        """Return the arm's reading with the estimate of f_e in it, 0 at first, and the total force f with it."""
        reading = self.arm.read()
        if reading is None:
            return None
        x = self.observer.system.at(reading.position, reading.velocity)
        force = self._estimate(reading, x)
        measured = reading.measured._replace(external_force=force, total_force=x.total_force(force))
        return reading._replace(measured=measured)

    def write(self, torque: Array) -> None:
        """Send a torque to the arm."""
        self.arm.write(torque)
        self._sent = torque

    def _estimate(self, reading: Reading, x: MechanicalState) -> Array:
        """Advance the observer to a reading, and return f_e, shape (n,) [N·m]."""
        system, weight = self.observer.system, x.gravity
        if self._state is None:
            self._state, self._time, self._weight = self.observer.start(x, weight), self._now(reading, 0.0), weight
            return np.zeros(system.n)
        passed = self._now(reading, self._time) - self._time
        if passed > _SHORTEST:
            torque = self._sent if reading.torque is None else reading.torque
            if self.gravity == "robot":
                torque = torque + system.motor_torque(0.5 * (self._weight + weight))
            self._state = self.observer.update(self._state, self._state.time + passed, x, weight, torque)
            self._time, self._weight = self._time + passed, weight
        force: Array = self.observer.reading(self._state)
        return force

    def _now(self, reading: Reading, before: float) -> float:
        """Return the time of a reading [s]."""
        return self._clock() - reading.age if reading.elapsed is None else before + reading.elapsed
