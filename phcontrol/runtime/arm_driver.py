"""What a driver of an arm is, and the loop that runs one."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, Protocol, get_args

from phcontrol._validation import Array, instance, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.runtime.control_loop import GRAVITY, ControlLoop, Gravity
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.simulation.run import MOST_STEPS

Pace = Literal["clock", "read", "write"]
"""Whose time a driver's is: this computer's, its ``read``'s, or its ``write``'s; see :class:`ArmDriver`."""


class Reading(NamedTuple):
    """What an arm reports.

    Example:
        >>> import numpy as np
        >>> from phcontrol import Reading
        >>> Reading(np.zeros(2), np.zeros(2), age=1e-3).torque is None
        True
    """

    position: Array
    """q, shape (n,) [rad]."""
    velocity: Array
    """q̇, shape (n,) [rad/s]."""
    measured: Measured = NOTHING
    """What else it measures."""
    age: float = 0.0
    """How old the reading is now [s]."""
    torque: Array | None = None
    """What the arm says it was sent, or held itself by, in the period before, shape (n,) [N·m], without its weight
    where it adds that itself; None where it does not say. The rate of a loop's first torque is counted from it, and
    that of the next where a torque was lost. A command, not a measurement of what motors do."""
    elapsed: float | None = None
    """Time since the reading before by the arm's own clock [s]; None where it has none. Gaps are counted by it."""


class ArmDriver(Protocol):
    """The way to an arm.

    Two attributes say what kind of arm it is, and there are no defaults: a wrong one moves the arm.

    - ``gravity``: "robot" for an arm that adds its own weight to what it is sent, so that it is sent u − G⁻¹g(q);
      "controller" for one whose motors do what they are sent.
    - ``pace``, whose time it is:
        "clock": this computer's; ``drive`` waits for each period, and ``read`` and ``write`` may not block for longer
        than a small part of one;
        "read": the robot's; ``read`` waits for the state of the next period, ``drive`` answers it at once, and the
        time that has ``elapsed`` is what the reading says: nothing drifts, and a robot that waits for its answers
        (a simulated one) is not taken for one that lost them;
        "write": the plant's; each ``write`` lets a period pass, as fast as it can be computed (simulators). The
        loop's ``clock`` must show that time, or it takes a slow computer for gaps.

    Example:
        >>> import numpy as np
        >>> from phcontrol import ControlLoop, EnergyShaping, MechanicalSystem, Reading, drive, load_robot
        >>> class Idle:  # an arm that stands still, whatever it is told
        ...     gravity, pace = "controller", "write"
        ...     now, torque = 0.0, np.zeros(2)
        ...     def read(self):
        ...         return Reading(np.zeros(2), np.zeros(2))
        ...     def write(self, torque):
        ...         self.now, self.torque = self.now + 1e-3, torque
        >>> system, arm = MechanicalSystem(load_robot("pera_shoulder")), Idle()
        >>> law = EnergyShaping(system, goal=[0.1, 0.0], stiffness=20.0, damping=5.0)
        >>> drive(ControlLoop(system, law, 1e-3, clock=lambda: arm.now, deadline=1.0), arm, 0.7)
        >>> (arm.torque - system.at([0.0, 0.0]).potential_gradient).round(2)  # 20 N·m/rad times 0.1 rad
        array([2., 0.])
    """

    gravity: Gravity
    """Who carries the arm's weight."""
    pace: Pace
    """Whose time it is."""

    def read(self) -> Reading | None:
        """Return the newest reading with its age: the same again when no newer one came; None before the first.

        Raises an error only where the arm has stopped and will not go on by itself.
        """
        ...

    def write(self, torque: Array) -> None:
        """Send a torque, shape (n,) [N·m], to be held until the next one."""
        ...


def drive(
    loop: ControlLoop,
    driver: ArmDriver,
    duration: float,
    *,
    each_step: Callable[[float, Reading, Array], None] | None = None,
) -> None:
    """Run a control loop on a driver for a duration [s]: read, step, write, and wait for the next period if need be.

    A period that the machine missed is left out. A driver that has no reading any more is taken to have its last one.
    The loop learns from the driver who carries the arm's weight.

    Args:
        loop: the control loop.
        driver: the arm.
        duration: [s].
        each_step: called with time, reading and the torque that was sent, for logging.

    Raises:
        InvalidArgumentError: what is given is no loop or no driver, the driver does not say who carries the weight, or
            whose time it is, or the duration has too many periods.
        ArmError: the arm stopped by itself.

    Example:
        >>> from phcontrol import ControlBox, ControlLoop, EnergyShaping, MechanicalSystem, SimulatedArm, drive
        >>> from phcontrol import load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> box = ControlBox(system, position=[0.0, 0.0])
        >>> law = EnergyShaping.tuned(system, [0.1, 0.0])
        >>> loop = ControlLoop(system, law, 1e-3, clock=lambda: box.time, deadline=1.0)
        >>> drive(loop, SimulatedArm(box), 1.0)
        >>> round(box.time, 3)  # [s]
        1.0
    """
    instance("loop", loop, ControlLoop)
    if each_step is not None and not callable(each_step):
        raise InvalidArgumentError("each_step", f"must be a function, but is {each_step!r}")
    steps = round(min(positive("duration", duration) / loop.period, 1e300))
    if steps > MOST_STEPS:
        raise InvalidArgumentError(
            "duration",
            f"of {duration:g} s has {steps:.2g} periods of {loop.period:g} s; at most {MOST_STEPS:.0e} are run",
        )
    paced = _declared(driver, "pace", get_args(Pace)) == "clock"
    loop.gravity = _declared(driver, "gravity", GRAVITY)
    for name in ("read", "write"):
        if not callable(getattr(driver, name, None)):
            raise InvalidArgumentError("driver", f"{type(driver).__name__} has no {name}: it is no ArmDriver")
    start, k = time.perf_counter(), 0
    last: Reading | None = None
    while k < steps:
        began = math.floor((time.perf_counter() - start) / loop.period)
        reading = driver.read()
        if reading is None and last is not None:
            reading = last._replace(age=last.age + loop.period)
        if reading is not None and not isinstance(reading, Reading):
            said = f"{type(driver).__name__} read a {type(reading).__name__}"
            raise InvalidArgumentError("driver", f"must read a Reading or None, but {said}")
        last = reading
        if reading is not None:
            torque = loop.step(
                reading.position,
                reading.velocity,
                reading.measured,
                age=reading.age,
                torque=reading.torque,
                elapsed=reading.elapsed,
            )
            driver.write(torque.copy())  # whatever it does to it, what is logged is what was sent
            if each_step is not None:
                each_step(k * loop.period, reading, torque)
        else:
            driver.write(loop.no_torque)
        k += 1
        if paced:  # periods that were missed are left out, not made up for in a burst
            k = max(k, began + 1, math.floor((time.perf_counter() - start) / loop.period))
            wait_until(start + k * loop.period)


def _declared(driver: object, name: str, options: tuple[str, ...]) -> Any:
    """Return what a driver says of itself. Raises InvalidArgumentError where it does not."""
    value = getattr(driver, name, None)
    if value not in options:
        listing = " or ".join(f"'{option}'" for option in options)
        said = "does not say" if value is None else f"says {value!r} for"
        raise InvalidArgumentError("driver", f"{type(driver).__name__} {said} its {name}; it must be {listing}")
    return value


def wait_until(moment: float) -> None:
    """Sleep, and watch the clock for the last tenth of a millisecond; return at once when the moment is past."""
    while True:
        left = moment - time.perf_counter()
        if left <= 0.0:
            return
        if left > 2e-4:
            time.sleep(left - 1e-4)
