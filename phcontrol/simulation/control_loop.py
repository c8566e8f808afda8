"""A law on a real arm: the same control as in simulation, with ramps, watchdogs and statistics around it."""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, number, per_joint, positive
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety.torque_filter import TorqueFilter
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.simulation.closed_loop import torque_limit_of
from phcontrol.simulation.sampled_control import SampledControl
from phcontrol.simulation.timing import Timing, TimingRecorder

_MOST_DAMPING = 1e9  # so that its torque is finite at any finite velocity [N·m·s/rad]
_STRANGE_IN_A_ROW = 3  # readings that do not fit before the loop stops
_MISSES_IN_A_ROW = 20  # deadlines missed before the loop stops
_RECOVERY_TIME = 0.1  # of good readings before the loop starts again by itself [s]
_JUMP_FACTOR = 2.0  # times the fastest motion within the limits


class LoopMode(IntEnum):
    """What a loop is doing."""

    WAITING = 0
    """No reading yet: no torque."""
    STARTING = 1
    """From holding to the law, within ``start_time``."""
    RUNNING = 2
    """The law's torque."""
    STOPPING = 3
    """From the last torque to holding, within ``stop_time``."""
    STOPPED = 4
    """Holding: gravity is carried, motion damped."""


class ControlLoop:
    """Turns readings of an arm into torques, once a period, on hardware as in simulation.

        torque = loop.step(q, v, measured, age=...)

    What it does besides the law:

    - **start**: for ``start_time`` the torque goes from *holding* (gravity and damping) over to the law's, whose
      state advances in the same proportion.
    - **stop**: ``stop()``, and each of the faults below, lets the torque go over to holding within ``stop_time``.
    - **stale readings**: a reading older than ``stale_after`` stops the loop. While it stays stale its velocity counts
      as unknown: holding carries gravity at the last position, without damping. After 0.1 s of fresh readings the
      loop starts again by itself, the law from its initial state.
    - **strange readings** (not finite, of a wrong length, or a jump that the velocity limits do not allow) are not
      used; the last good one is, and grows older. Three in a row stop the loop; it starts again as above.
    - **deadline**: a step that computes for longer than ``deadline`` is counted; 20 in a row stop the loop for good.
    - **errors** of the law (a measurement that is missing, a torque that is not finite) stop the loop for good:
      ``fault`` has the error. ``restart()`` is needed then, as after ``stop()``.

    Every torque passes the torque filter, or is clipped to the torque limit, and is finite.

    Args:
        system: the model of the arm, for holding.
        controller: the law.
        period: [s].
        torque_filter: keeps the arm inside its limits; for the same period.
        torque_limit: "robot" for the joints' effort limits, numbers [N·m], or None.
        start_time: [s].
        stop_time: [s].
        holding_damping: of the joints [N·m·s/rad], one or one each; by default what stops M(home)'s diagonal in 0.2 s.
        stale_after: [s]; by default 10 periods.
        deadline: of one step's computation [s]; by default the period.
        clock: what time is read from [s].
    """

    def __init__(
        self,
        system: MechanicalSystem,
        controller: Controller,
        period: float,
        *,
        torque_filter: TorqueFilter | None = None,
        torque_limit: Literal["robot"] | ArrayLike | None = "robot",
        start_time: float = 0.5,
        stop_time: float = 0.2,
        holding_damping: ArrayLike | None = None,
        stale_after: float | None = None,
        deadline: float | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.period = positive("period", period)
        if controller.system.n != system.n:
            raise InvalidArgumentError("controller", f"is for {controller.system.n} joints, the system has {system.n}")
        self.system = system
        self.start_time = number("start_time", start_time, minimum=0.0)
        self.stop_time = number("stop_time", stop_time, minimum=0.0)
        self.stale_after = 10.0 * self.period if stale_after is None else positive("stale_after", stale_after)
        self.deadline = self.period if deadline is None else positive("deadline", deadline)
        inertia = system.at(system.robot.home).mass_matrix.diagonal() / 0.2
        damping: Array = inertia if holding_damping is None else per_joint("holding_damping", holding_damping, system.n)
        if (damping < 0.0).any() or (damping > _MOST_DAMPING).any():
            raise InvalidArgumentError("holding_damping", f"must be 0 to {_MOST_DAMPING:g} N·m·s/rad")
        self._damping = np.array(damping)
        self._sampled = SampledControl(controller, period, torque_limit_of(torque_limit, system), torque_filter)
        self._fastest = _JUMP_FACTOR * np.where(
            np.isinf(system.robot.velocity_limit), 100.0, system.robot.velocity_limit
        )
        self._clock, self._recorder = clock, TimingRecorder()
        self._state = np.zeros(controller.state_size)
        self.mode = LoopMode.WAITING
        self.fault: PHControlError | None = None
        """The error that stopped the loop for good."""
        self.reason = ""
        """Why the loop last stopped."""
        self.counts = {"stale": 0, "strange": 0, "stops": 0}
        """Steps with a stale reading, readings not used, and stops."""
        self._latched = False
        self._time = 0.0
        self._steps_in_mode = self._good_in_a_row = self._strange_in_a_row = self._misses_in_a_row = 0
        self._last: tuple[Array, Array] | None = None
        self._last_age = 0.0
        self._last_begin = clock()
        self._start_of_stop: Array = np.zeros(system.n)

    @property
    def torque_filter(self) -> TorqueFilter | None:
        """The torque filter, with its counts."""
        return self._sampled.filter

    @property
    def controller_state(self) -> Array:
        """The law's own state."""
        return self._state

    @property
    def no_torque(self) -> Array:
        """Zeros, for an arm that has not reported yet [N·m]."""
        return np.zeros(self.system.n)

    @property
    def timing(self) -> Timing:
        """How long the steps computed, and how far apart they were."""
        return self._recorder.timing(self.deadline)

    def stop(self, reason: str = "asked to stop") -> None:
        """Go over to holding and stay there until ``restart``."""
        self._latched = True
        self._stop(reason)

    def restart(self) -> None:
        """Start again after ``stop`` or an error."""
        self._latched, self.fault, self.reason = False, None, ""
        self._good_in_a_row = self._strange_in_a_row = self._misses_in_a_row = 0
        if self.mode != LoopMode.WAITING:
            self._enter(LoopMode.STARTING)

    def step(
        self, position: ArrayLike, velocity: ArrayLike, measured: Measured = NOTHING, *, age: float = 0.0
    ) -> Array:
        """Return the torque for the next period, shape (n,) [N·m].

        Args:
            position: q [rad].
            velocity: q̇ [rad/s].
            measured: what else was measured.
            age: how old the reading is [s]; a driver that has no new one passes the last again, with its age.
        """
        begin = self._clock()
        self._last_age += max(self.period, begin - self._last_begin)  # longer, where periods were missed
        self._last_begin = begin
        fresh = self._take(position, velocity, age)
        if self._last is None:
            return self._finish(begin, np.zeros(self.system.n))
        x = self._sampled.controller.system.at(*self._last)
        stale = self._last_age > self.stale_after
        if stale:
            self.counts["stale"] += 1
            if self.mode in (LoopMode.STARTING, LoopMode.RUNNING):
                self._stop(f"no reading for {self._last_age:g} s")
        self._good_in_a_row = self._good_in_a_row + 1 if fresh else 0
        if self.mode == LoopMode.STOPPED and not self._latched and self._good_in_a_row * self.period >= _RECOVERY_TIME:
            self._enter(LoopMode.STARTING)
        torque = self._torque(x, measured, stale)
        self._time += self.period
        self._steps_in_mode += 1
        return self._finish(begin, torque)

    # --- readings -----------------------------------------------------------------------------------

    def _take(self, position: ArrayLike, velocity: ArrayLike, age: float) -> bool:
        """Take a reading over if it makes sense; return whether it was good and fresh."""
        n = self.system.n
        try:
            q, v, old = np.array(position, dtype=float), np.array(velocity, dtype=float), float(age)
        except (TypeError, ValueError, OverflowError):
            return self._reject()
        if q.shape != (n,) or v.shape != (n,) or not np.isfinite(q.dot(q) + v.dot(v)) or not old >= 0.0:
            return self._reject()
        if self._last is not None and old < self._last_age and self._jumps(q, v, self._last_age):
            return self._reject()
        self._strange_in_a_row = 0
        if self._last is None:
            self._last = (q, v)
            self._enter(LoopMode.STARTING)
        elif old < self._last_age:
            self._last = (q, v)
        self._last_age = min(old, self._last_age)
        return old <= self.stale_after

    def _jumps(self, q: Array, v: Array, elapsed: float) -> bool:
        """Whether the arm cannot have come here, within its velocity limits, since the last good reading."""
        assert self._last is not None
        if self._strange_in_a_row >= _STRANGE_IN_A_ROW:
            return False  # it is there for good; the loop has stopped and starts from there
        moved = np.abs(self.system.robot.difference(q, self._last[0]))
        reach = np.maximum(self._fastest, np.abs(self._last[1])) * (elapsed + self.period)
        return bool((moved > reach).any() or (np.abs(v) > 5.0 * self._fastest).any())

    def _reject(self) -> bool:
        self.counts["strange"] += 1
        self._strange_in_a_row += 1
        if self._strange_in_a_row >= _STRANGE_IN_A_ROW and self.mode in (LoopMode.STARTING, LoopMode.RUNNING):
            self._stop(f"{self._strange_in_a_row} readings in a row do not make sense")
        return False

    # --- torques ------------------------------------------------------------------------------------

    def _torque(self, x: MechanicalState, measured: Measured, stale: bool) -> Array:
        if self.mode in (LoopMode.STARTING, LoopMode.RUNNING):
            try:
                return self._law_torque(x, measured)
            except PHControlError as error:
                self.fault, self._latched = error, True
                self._stop(f"{type(error).__name__}: {error}")
        holding = self._holding(x, stale)
        if self.mode == LoopMode.STOPPING:
            part = _smooth(self._steps_in_mode * self.period, self.stop_time)
            if part >= 1.0:
                self._enter(LoopMode.STOPPED)
            holding = (1.0 - part) * self._start_of_stop + part * holding
        return self._passed(x, holding, measured)

    def _law_torque(self, x: MechanicalState, measured: Measured) -> Array:
        sampled = self._sampled
        if self.mode == LoopMode.STARTING and self._steps_in_mode == 0:
            self._state = sampled.controller.initial_state(x)
            sampled.forget()
        part = 1.0
        if self.mode == LoopMode.STARTING:
            part = _smooth(self._steps_in_mode * self.period, self.start_time)
            if part >= 1.0:
                self._enter(LoopMode.RUNNING)
        self._state = sampled.advance(self._state)
        if part >= 1.0:
            return sampled.step(self._time, x, self._state, measured)
        command = sampled.controller.evaluate(self._time, x, self._state, measured)
        sampled.hold_rate(part * command.state_rate)
        return self._passed(x, part * command.torque + (1.0 - part) * self._holding(x, False), measured)

    def _holding(self, x: MechanicalState, stale: bool) -> Array:
        """Return the torque that carries the arm's weight and damps its motion."""
        force = x.potential_gradient if stale else x.potential_gradient - self._damping * x.velocity
        return x.system.motor_torque(force)

    def _passed(self, x: MechanicalState, torque: Array, measured: Measured) -> Array:
        """Return a torque that is not the law's after filter and limits."""
        return self._sampled.limited(x, torque, measured)

    def _finish(self, begin: float, torque: Array) -> Array:
        end = self._clock()
        self._recorder.record(begin, end)
        self._misses_in_a_row = self._misses_in_a_row + 1 if end - begin > self.deadline else 0
        if self._misses_in_a_row >= _MISSES_IN_A_ROW and self.mode in (LoopMode.STARTING, LoopMode.RUNNING):
            self._latched = True
            self._stop(f"{self._misses_in_a_row} deadlines in a row were missed")
        return torque

    # --- modes --------------------------------------------------------------------------------------

    def _stop(self, reason: str) -> None:
        self.reason = reason
        if self.mode in (LoopMode.STARTING, LoopMode.RUNNING):
            self.counts["stops"] += 1
            last = self._sampled.torque
            self._start_of_stop = np.zeros(self.system.n) if last is None else last
            self._enter(LoopMode.STOPPING)

    def _enter(self, mode: LoopMode) -> None:
        self.mode, self._steps_in_mode = mode, 0
        if mode != LoopMode.STOPPED:
            self._good_in_a_row = 0


def _smooth(elapsed: float, duration: float) -> float:
    """Return a smooth course from 0 to 1."""
    if elapsed >= duration:
        return 1.0
    part = elapsed / duration
    return part * part * (3.0 - 2.0 * part)
