"""A law on a real arm: the same control as in simulation, with ramps, watchdogs and statistics around it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._smooth import smooth
from phcontrol._validation import Array, choice, number, per_joint, positive, real_array
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runtime.loop_camera import LoopCamera
from phcontrol.runtime.loop_clock import LoopClock
from phcontrol.runtime.loop_mode import LoopMode
from phcontrol.runtime.measured_borders import MeasuredBorders
from phcontrol.runtime.restart_policy import RestartPolicy
from phcontrol.runtime.safe_starts import SafeStarts
from phcontrol.runtime.signal_border import SignalBorder
from phcontrol.runtime.start_check import StartCheck
from phcontrol.runtime.timing import Timing, TimingRecorder
from phcontrol.runtime.torque_gate import TorqueGate
from phcontrol.safety.torque_filter import FilteredTorque, TorqueFilter
from phcontrol.safety.torque_range import RobotShare
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.setpoints.setpoint import Setpoint
from phcontrol.simulation.run import torque_limit_of
from phcontrol.simulation.sampled_control import SampledControl

Gravity = Literal["robot", "controller"]
GRAVITY: tuple[str, ...] = get_args(Gravity)
_MOST_DAMPING = 1e9  # so that its torque is finite at any finite velocity [N·m·s/rad]
_SENT = 1e-4  # by which an arm's word of what it was sent is rounded [N·m]
_MOST_MISSED = 20  # periods more than kept, before the loop stops
_JUMP_FACTOR = 2.0  # times the fastest motion within the limits
_SPEED_FACTOR = 5.0  # times that, which no true velocity reaches
_LONGEST = 1e5  # period, or age of a reading [s]
_BEYOND = 2.0 * math.pi  # the limits, where no joint is [rad]
_MOST_TURNS = 1e6  # of a joint without limits [rad]


class ControlLoop:
    """Turns readings of an arm into torques, once a period, on hardware as in simulation.

        torque = loop.step(q, v, measured, age=...)

    What it does besides the law:

    - **start**: for ``start_time`` the torque goes from *holding* (gravity and damping) over to the law's, whose
      state advances in the same proportion.
    - **stop**: ``stop()``, and each of the faults below, lets the torque go over to holding within ``stop_time``.
    - **stale readings**: a reading older than ``stale_after`` stops the loop. While it stays stale its velocity counts
      as unknown: holding compensates gravity at the last position, without damping.
    - **gaps**: so does a pause of more than ``stale_after`` from one step to the next.
    - **implausible readings** (not real numbers, not finite, of a wrong shape, beyond all limits, or a jump that the
      velocity limits do not allow) are not used; the last good one is, and grows older. Three in a row stop the loop.
    - **implausible measurements** (:class:`MeasuredBorders`): likewise; the loop stops if the law needs them, otherwise
      they count as not measured. A measurement that a law needs and never had is an error of the law.
    - **deadline**: periods in which a step computes for longer than ``deadline``, or comes too late or not at all, are
      counted as missed. 20 more missed than kept stop the loop (twice ``stale_after``, if that is more).
    - **restarts**: after these stops the loop starts again by itself, the law from its initial state, when readings
      are good again; later each time, and not for ever: see :class:`RestartPolicy`.
    - **errors**: whatever a law, the torque filter or a model raises or returns in place of finite numbers stops the
      loop for good: ``fault`` has the exception. ``restart()`` is needed then, as after ``stop()`` or giving up.
    - **safe starts**: with a ``safe_set`` a start from outside it stops the loop for good, or only warns
      (``unsafe_start="warn"``). The ramp of ``start_time`` is no part of that proof.

    ``step`` raises no exception but those that end a program. Every torque passes the torque filter, or is clipped to
    the torque limit, passes a last check (:class:`TorqueGate`), and is the caller's own.

    **Who carries the weight**: with ``gravity="robot"`` the arm adds G⁻¹g(q) itself, and what ``step`` returns is
    u − G⁻¹g(q), to be sent; limits of effort and rate hold for both. The first torque too is within the rate of what
    the arm carried before: what the reading says, and otherwise its own weight, by which it stood still.

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
        setpoint: what is changed while the loop runs; brought up to date before each step of the law.
        safe_set: a :class:`SafeSet` of the law, which every start must be in.
        unsafe_start: "refuse" or "warn".
        camera: a camera in the hand, with frames at its own rate: image features are measured with each reading.
        gravity: "controller" for an arm whose motors do what they are sent, "robot" for one that adds its own weight
            (Franka, UR, KUKA); ``drive`` sets what the driver says.
        clock: what time is read from [s]. One that does not tell it, or fails, stops the loop for good.

    Example:
        >>> from phcontrol import ControlBox, ControlLoop, EnergyShaping, MechanicalSystem, SimulatedArm, drive
        >>> from phcontrol import load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping.tuned(system, [0.1, 0.0])
        >>> box = ControlBox(system, period=1e-3, position=[0.0, 0.0])
        >>> loop = ControlLoop(system, law, 1e-3, clock=lambda: box.time, deadline=1.0)
        >>> drive(loop, SimulatedArm(box), 4.0)
        >>> loop.mode.name, box.reading().position.round(3)
        ('RUNNING', array([0.1, 0. ]))
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
        setpoint: Setpoint | None = None,
        camera: LoopCamera | None = None,
        safe_set: SafeStarts | None = None,
        unsafe_start: Literal["refuse", "warn"] = "refuse",
        gravity: Gravity = "controller",
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        check_loop(controller, system)
        self.period = positive("period", period, maximum=_LONGEST)
        if controller.system.n != system.n:
            raise InvalidArgumentError("controller", f"is for {controller.system.n} joints, the system has {system.n}")
        system.need_constant_input("the stop of a control loop")
        self.system = system
        self.start_time = number("start_time", start_time, minimum=0.0)
        self.stop_time = number("stop_time", stop_time, minimum=0.0)
        stale = 10.0 * self.period if stale_after is None else stale_after
        self.stale_after = positive("stale_after", stale, maximum=10.0 * _LONGEST)
        self.deadline = self.period if deadline is None else positive("deadline", deadline)
        inertia = system.at(system.robot.home).mass_matrix.diagonal() / 0.2
        damping: Array = inertia if holding_damping is None else per_joint("holding_damping", holding_damping, system.n)
        if (damping < 0.0).any() or (damping > _MOST_DAMPING).any():
            raise InvalidArgumentError("holding_damping", f"must be 0 to {_MOST_DAMPING:g} N·m·s/rad")
        self._damping = np.array(damping)
        limit = torque_limit_of(torque_limit, system)
        self._sampled = SampledControl(controller, period, limit, torque_filter)
        self._gate = _gate(system.n, limit, torque_filter)
        robot = system.robot
        self._fastest = _JUMP_FACTOR * np.where(np.isinf(robot.velocity_limit), 100.0, robot.velocity_limit)
        highest = _SPEED_FACTOR * self._fastest
        self._reading = SignalBorder(
            np.concatenate([np.where(np.isinf(robot.lower), -_MOST_TURNS, robot.lower - _BEYOND), -highest]),
            np.concatenate([np.where(np.isinf(robot.upper), _MOST_TURNS, robot.upper + _BEYOND), highest]),
            self._jumps,
        )
        self._measured = MeasuredBorders(controller, robot)
        Setpoint.check(setpoint)
        self.setpoint = setpoint
        if camera is not None and not isinstance(camera, LoopCamera):
            raise InvalidArgumentError("camera", f"must be a LoopCamera, but is {type(camera).__name__}")
        self._camera = camera
        self._starts = StartCheck(safe_set, controller, unsafe_start)
        self._clock, self._recorder = LoopClock(clock), TimingRecorder(self.period, self.deadline)
        self._restarts = RestartPolicy(self.period)
        self._state: Array = np.zeros(controller.state_size)
        self.mode = LoopMode.WAITING
        self.fault: Exception | None = None
        """The error that stopped the loop for good, the first of them."""
        self.reason = ""
        """Why the loop last stopped."""
        self.counts = {"stale": 0, "implausible": 0, "measured": 0, "stops": 0, "lost": 0}
        """Steps with a stale reading, readings not used, measurements not used, stops, and torques that the arm says
        it did not get."""
        self._latched = False
        self._time = 0.0
        self._steps_in_mode = self._missed = 0
        self._most_missed = max(_MOST_MISSED, round(2.0 * self.stale_after / self.period))
        self._start_of_stop: Array = np.zeros(system.n)
        self._weight: Array = np.zeros(system.n)
        self._share: RobotShare | None = None
        self.gravity = gravity

    @property
    def gravity(self) -> Gravity:
        """Who carries the arm's weight, "robot" or "controller"; fixed once the arm has reported."""
        return self._gravity

    @gravity.setter
    def gravity(self, value: Gravity) -> None:
        chosen: Any = choice("gravity", value, GRAVITY)
        if self.mode != LoopMode.WAITING and chosen != self._gravity:
            raise InvalidArgumentError("gravity", f"is '{self._gravity}' and cannot change while the loop runs")
        self._gravity: Gravity = chosen

    @property
    def torque_filter(self) -> TorqueFilter | None:
        """The torque filter, with its counts."""
        return self._sampled.filter

    @property
    def controller_state(self) -> Array:
        """The law's own state, read-only."""
        return self._state

    @property
    def law_name(self) -> str:
        """The law's name."""
        return self._sampled.controller.name

    @property
    def desired_torque(self) -> Array:
        """The law's own torque in the last step in which it ran on its own [N·m]."""
        return self._sampled.desired

    @property
    def filtered(self) -> FilteredTorque | None:
        """What the torque filter said in the last step; None without one."""
        return self._sampled.filtered

    @property
    def computing(self) -> float:
        """How long the last step computed [s]."""
        return self._recorder.last

    @property
    def no_torque(self) -> Array:
        """Zeros, for an arm that has not reported yet [N·m]."""
        return np.zeros(self.system.n)

    @property
    def timing(self) -> Timing:
        """How long the steps computed, and how far apart they were."""
        return self._recorder.timing

    def stop(self, reason: str = "asked to stop") -> None:
        """Go over to holding and stay there until ``restart``."""
        self._latched = True
        self._stop(reason)

    def restart(self) -> None:
        """Start again after ``stop``, an error or giving up."""
        self._latched, self.fault, self.reason = False, None, ""
        self._restarts.reset()
        self._reading.forgive()
        if self.mode != LoopMode.WAITING:
            self._enter(LoopMode.STARTING)

    def step(
        self,
        position: ArrayLike,
        velocity: ArrayLike,
        measured: Measured = NOTHING,
        *,
        age: float = 0.0,
        torque: ArrayLike | None = None,
        elapsed: float | None = None,
    ) -> Array:
        """Return the torque to send for the next period, shape (n,) [N·m]: a copy, the caller's own.

        Args:
            position: q [rad].
            velocity: q̇ [rad/s].
            measured: what else was measured, with the reading.
            age: how old the reading is [s]; a driver that has no new one passes the last again, with its age.
            torque: what the arm says it was sent, or held itself by, in the period before [N·m], without its weight
                where the robot adds that. The first torque's rate counts from it (None: the arm carried its weight),
                and where a torque was lost on its way, the rate of the next.
            elapsed: time since the reading before by the arm's own clock [s], where the arm is the clock; None: the
                loop's clock says it.
        """
        since = real_array(elapsed, ())
        told = None if since is None or since < 0.0 else float(since)
        passed = max(self.period, self._recorder.begin(self._look_at_clock(), told))  # longer after a gap
        try:
            ordered = self._controlled(position, velocity, measured, age, passed, torque)
        except Exception as error:  # of the model or the filter: the ramp goes on without them
            self._fail(error)
            ordered = self._without_model()
        leaving = self._leave(ordered)
        if ordered is not None:
            self._time += self.period
            self._steps_in_mode += 1
        missed = self._recorder.end(self._look_at_clock())
        self._missed = max(0, self._missed + (missed or -1))
        if self._missed >= self._most_missed and self.mode.is_active:
            self._stop_for_now(f"{self._missed} periods more were missed than kept")
        return leaving

    def _controlled(
        self, position: Any, velocity: Any, measured: Any, age: Any, elapsed: float, before: Any
    ) -> Array | None:
        """Return the torque for one reading; None before the first [N·m]."""
        fresh = self._take(position, velocity, measured, age, elapsed)
        if self.mode == LoopMode.WAITING:
            if not fresh:
                return None
            self._enter(LoopMode.STOPPED if self._latched else LoopMode.STARTING)
        stale, gap = self._reading.age > self.stale_after, elapsed > self.stale_after
        missing = self._measured.missing(self.stale_after)
        self.counts["stale"] += stale
        if self.mode.is_active:
            self._watch(stale, gap, missing, elapsed)
        self._consider_restart(fresh and not gap and not missing, elapsed)
        assert self._reading.value is not None
        n = self.system.n
        q, v = self._reading.value[:n], self._reading.value[n:]
        x = self._sampled.controller.system.at(q, v)
        self._weigh(x.seen_by(self.system))
        self._look_back(before)
        self._sampled.share = self._share
        return self._torque(x, self._measured.seen(self.stale_after), stale)

    def _look_at_clock(self) -> float:
        """Return the time [s]; where the clock shows none, stop for good."""
        now = self._clock.now()
        if self._clock.error is not None:
            self._fail(self._clock.error)
        return now

    # --- readings -----------------------------------------------------------------------------------

    def _take(self, position: Any, velocity: Any, measured: Any, age: Any, elapsed: float) -> bool:
        """Take over what makes sense of a reading; return whether it is a good one, and fresh."""
        reading, shape = self._reading, (self.system.n,)
        reading.elapse(elapsed)
        self._measured.elapse(elapsed)
        old = age if type(age) is float else real_array(age, ())
        seconds = math.inf if old is None or not old >= 0.0 else float(old)
        q, v = real_array(position, shape), real_array(velocity, shape)
        if self._camera is not None and q is not None and seconds < reading.age:
            shown = measured if isinstance(measured, Measured) else NOTHING
            measured = shown._replace(features=self._camera.features(self._look_at_clock() - seconds, q))
        if seconds < reading.age:
            self.counts["measured"] += self._measured.offer(NOTHING if measured is None else measured, seconds)
        both = None if q is None or v is None or seconds == math.inf else np.concatenate((q, v))
        if not reading.offer(both, seconds):
            self.counts["implausible"] += 1
            return False
        return seconds <= self.stale_after

    def _jumps(self, reading: Array, last: Array, elapsed: float) -> bool:
        """Whether the arm cannot have come here, within its velocity limits, since the last good reading."""
        n = self.system.n
        moved = np.abs(self.system.robot.difference(reading[:n], last[:n]))
        reach = np.maximum(self._fastest, np.abs(last[n:])) * (elapsed + self.period)
        return bool((moved > reach).any())

    def _watch(self, stale: bool, gap: bool, missing: str, elapsed: float) -> None:
        """Stop when there is too little to go by."""
        if gap:
            self._stop_for_now(f"no step for {elapsed:g} s")
        elif stale:
            self._stop_for_now(f"no reading for {self._reading.age:g} s")
        elif not self._reading.is_trusted:
            self._stop_for_now(f"{self._reading.rejected_in_a_row} readings in a row do not make sense")
        elif missing:
            self._stop_for_now(missing)

    # --- torques ------------------------------------------------------------------------------------

    def _weigh(self, x: MechanicalState) -> None:
        """Note what holds the arm, and what of it the robot adds by itself; what is not finite changes nothing."""
        weight = real_array(x.potential_gradient, (self.system.n,))
        if weight is not None:
            self._weight = weight
        if self._gravity == "robot":
            adds = real_array(self.system.motor_torque(x.gravity), (self.system.n,))
            if adds is not None:
                self._share = RobotShare(adds, adds if self._share is None else self._share.before)

    def _look_back(self, before: Any) -> None:
        """Take over what the arm carries before the first torque, and what it still holds where it missed the last."""
        told, zero = real_array(before, (self.system.n,)), self.no_torque
        carried = told if told is None or self._share is None else told + self._share.before
        if self._gate.previous is None:
            self._gate.previous = self.system.motor_torque(self._weight) if carried is None else carried
            self._sampled.torque = self._gate.previous
        elif carried is not None and np.abs(carried - self._gate.previous).max() > _SENT:
            self.counts["lost"] += 1
            if self._share is None:
                self._share = RobotShare(zero, zero)
            self._share = self._share._replace(held=carried)

    def _torque(self, x: MechanicalState, measured: Measured, stale: bool) -> Array:
        if self.mode.is_active:
            try:
                return self._law_torque(x, measured)
            except Exception as error:  # of a law, whatever it is
                self._fail(error)
        return self._sampled.limited(x, self._ramped(self._holding(stale)), measured)

    def _law_torque(self, x: MechanicalState, measured: Measured) -> Array:
        sampled = self._sampled
        if self.setpoint is not None:
            self.setpoint.advance(self._time)
        if self.mode == LoopMode.STARTING and self._steps_in_mode == 0:
            self._state = sampled.initial_state(x)
            self._starts.check(x, self._state)
        part = 1.0
        if self.mode == LoopMode.STARTING:
            part = _smooth(self._steps_in_mode * self.period, self.start_time)
            if part >= 1.0:
                self._enter(LoopMode.RUNNING)
        self._state = sampled.controller.jump(self._time, x, sampled.advance(self._state), measured)
        self._state.flags.writeable = False
        if part >= 1.0:
            return sampled.step(self._time, x, self._state, measured)
        command = sampled.command(self._time, x, self._state, measured)
        sampled.hold_rate(part * command.state_rate)
        return sampled.limited(x, part * command.torque + (1.0 - part) * self._holding(False), measured)

    def _holding(self, stale: bool) -> Array:
        """Return the torque that compensates the arm's weight and damps its motion [N·m]; needs no model."""
        force = self._weight
        if not stale and self._reading.value is not None:
            force = force - self._damping * self._reading.value[self.system.n :]
        return self.system.motor_torque(force)

    def _ramped(self, holding: Array) -> Array:
        """Return the torque of a stop: on the way to holding, or there [N·m]."""
        if self.mode != LoopMode.STOPPING:
            return holding
        part = _smooth(self._steps_in_mode * self.period, self.stop_time)
        if part >= 1.0:
            self._enter(LoopMode.STOPPED)
        torque: Array = (1.0 - part) * self._start_of_stop + part * holding
        return torque

    def _without_model(self) -> Array | None:
        """Return the torque of a stop where model and filter fail [N·m]; None before the first reading."""
        if self.mode == LoopMode.WAITING:
            return None
        with np.errstate(all="ignore"):  # whatever a law has set: nothing may be raised here
            return self._ramped(self._holding(self._reading.age > self.stale_after))

    def _leave(self, torque: Array | None) -> Array:
        """Return what is sent: a copy of a torque that passed the last check; zeros for None."""
        if torque is None:
            return self.no_torque
        leaving = self._gate.passed(torque, self._share)
        if leaving is None:
            self._fail(PHControlError(f"a torque that is not {self.system.n} finite numbers came to the last check"))
            leaving = self._gate.passed(self._without_model(), self._share)
        assert leaving is not None
        self._sampled.torque = leaving
        sent = self._gate.sent(leaving, self._share)
        if self._share is not None:
            self._share = self._share._replace(before=self._share.now, held=None)
        return sent

    # --- modes --------------------------------------------------------------------------------------

    def _consider_restart(self, good: bool, elapsed: float) -> None:
        """Start again after a stop that may pass by itself, or give that up."""
        restarts = self._restarts
        if self._latched:
            return
        if self.mode.is_active:
            restarts.note_running()
            return
        restarts.note_waiting(good, elapsed)
        if self.mode != LoopMode.STOPPED:
            return
        if restarts.is_ready:
            self._enter(LoopMode.STARTING)
        elif restarts.complaint:
            self._latched, self.reason = True, f"{self.reason}; {restarts.complaint}"

    def _stop_for_now(self, reason: str) -> None:
        """Stop for a reason that may pass by itself."""
        complaint = self._restarts.note_stop()
        self._latched = bool(complaint)
        self._stop(f"{reason}; {complaint}" if complaint else reason)

    def _fail(self, error: Exception) -> None:
        """Stop for good, because of an error."""
        self._latched = True
        if self.fault is None:
            self.fault = error
            self._stop(_described(error))

    def _stop(self, reason: str) -> None:
        self.reason = reason
        if self.mode.is_active:
            self.counts["stops"] += 1
            last = self._gate.previous
            if last is None:  # nothing to go over from
                self._enter(LoopMode.STOPPED)
            else:
                self._start_of_stop = last
                self._enter(LoopMode.STOPPING)

    def _enter(self, mode: LoopMode) -> None:
        self.mode, self._steps_in_mode = mode, 0
        if mode == LoopMode.STARTING:
            self._missed = 0


def _gate(n: int, limit: Array | None, torque_filter: TorqueFilter | None) -> TorqueGate:
    """Return the last check for a torque limit and the limits of a filter."""
    effort, step = np.full(n, np.inf), np.full(n, np.inf)
    if torque_filter is not None:
        effort = np.minimum(effort, torque_filter.limits.effort)
        step = torque_filter.period * torque_filter.limits.torque_rate
    return TorqueGate(effort if limit is None else np.minimum(effort, limit), step)


def _described(error: Exception) -> str:
    """Return an error in words, whatever its own words do."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:
        return type(error).__name__


def _smooth(elapsed: float, duration: float) -> float:
    """Return a smooth course from 0 to 1."""
    return 1.0 if elapsed >= duration else smooth(elapsed / duration)
