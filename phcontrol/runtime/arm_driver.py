"""What a driver of an arm is, and the loop that runs one."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

from phcontrol._validation import Array, flag, positive
from phcontrol.runtime.control_loop import ControlLoop
from phcontrol.sensors.measured import NOTHING, Measured


class Reading(NamedTuple):
    """What an arm reports."""

    position: Array
    """q, shape (n,) [rad]."""
    velocity: Array
    """q̇, shape (n,) [rad/s]."""
    measured: Measured = NOTHING
    """What else it measures."""
    age: float = 0.0
    """How old the reading is now [s]."""


class ArmDriver(Protocol):
    """The way to an arm. Neither method may block for longer than a small part of a period."""

    def read(self) -> Reading | None:
        """Return the newest reading with its age: the same again when no newer one came; None before the first."""
        ...

    def write(self, torque: Array) -> None:
        """Send a torque, shape (n,) [N·m], to be held until the next one."""
        ...


def drive(
    loop: ControlLoop,
    driver: ArmDriver,
    duration: float,
    *,
    paced: bool = True,
    each_step: Callable[[float, Reading, Array], None] | None = None,
) -> None:
    """Run a control loop on a driver for a duration [s]: read, step, write, wait for the next period.

    A period that the machine missed is left out. A driver that has no reading any more is taken to have its last one.

    Args:
        loop: the control loop.
        driver: the arm.
        duration: [s].
        paced: wait for the clock; False for an arm whose time goes on with each ``write`` (:class:`SimulatedArm`),
            which the loop's ``clock`` must then show.
        each_step: called with time, reading and torque, for logging.
    """
    flag("paced", paced)
    start, steps, k = time.perf_counter(), round(positive("duration", duration) / loop.period), 0
    last: Reading | None = None
    while k < steps:
        began = math.floor((time.perf_counter() - start) / loop.period)
        reading = driver.read()
        if reading is None and last is not None:
            reading = last._replace(age=last.age + loop.period)
        last = reading
        if reading is not None:
            torque = loop.step(reading.position, reading.velocity, reading.measured, age=reading.age)
            driver.write(torque.copy())  # whatever it does to it, what is logged is what was sent
            if each_step is not None:
                each_step(k * loop.period, reading, torque)
        else:
            driver.write(loop.no_torque)
        k += 1
        if paced:  # periods that were missed are left out, not made up for in a burst
            k = max(k, began + 1, math.floor((time.perf_counter() - start) / loop.period))
            wait_until(start + k * loop.period)


def wait_until(moment: float) -> None:
    """Sleep, and watch the clock for the last tenth of a millisecond; return at once when the moment is past."""
    while True:
        left = moment - time.perf_counter()
        if left <= 0.0:
            return
        if left > 2e-4:
            time.sleep(left - 1e-4)
