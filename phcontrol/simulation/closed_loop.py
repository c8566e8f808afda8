"""Plant and controller in closed loop, with fixed steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from phcontrol._validation import flag
from phcontrol.controllers.controller import Controller
from phcontrol.environments.body import Body
from phcontrol.exceptions import (
    InvalidArgumentError,
    ObjectLostError,
    PHControlError,
)
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety.torque_filter import TorqueFilter
from phcontrol.sensors.joint_sensor import JointSensor
from phcontrol.sensors.sensor import Sensor
from phcontrol.setpoints.setpoint import Setpoint
from phcontrol.simulation.compiled_run import Prepared, plan_of, prepared, run_compiled
from phcontrol.simulation.instruments import Encoders
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import Log
from phcontrol.simulation.run import Run
from phcontrol.simulation.simulation_error import SimulationError, SimulationInterrupted
from phcontrol.simulation.torque_line import TorqueLine
from phcontrol.simulation.vector_field import NOTHING_HELD, ExternalForce
from phcontrol.vision.scene import Scene

_DIVERGED = 1e9  # no arm gets there, nor a law's state; where numbers overflow is no news


def simulate(
    system: MechanicalSystem,
    controller: Controller,
    *,
    duration: float,
    dt: float = 1e-3,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    controller_state0: ArrayLike | None = None,
    disturbance: ExternalForce | ArrayLike | None = None,
    integrator: str = "rk4",
    control_period: float | None = None,
    torque_limit: Literal["robot"] | ArrayLike | None = "robot",
    torque_filter: TorqueFilter | None = None,
    sensors: Sequence[Sensor] | None = None,
    bodies: Sequence[Body] = (),
    scene: Scene | None = None,
    joint_sensor: JointSensor | None = None,
    torque_delay: float = 0.0,
    setpoint: Setpoint | None = None,
    progress: bool | None = None,
    watch: Callable[[Log], None] | None = None,
    compiled: bool = False,
) -> Log:
    """Run a plant under a controller and return the log.

    Args:
        system: the plant. The controller computes with its own ``system``, which may differ.
        controller: the law.
        duration: simulated time [s]; rounded up to whole steps.
        dt: step of the integrator [s]; times are k·dt.
        q0: initial position [rad], by default the robot's home.
        v0: initial velocity [rad/s], by default 0.
        controller_state0: the controller's initial state, by default what it says itself.
        disturbance: external force f_e on the joints [N·m]: constant, or a function of time and state.
        integrator: a name in ``INTEGRATORS``.
        control_period: None for a continuous controller, whose state is integrated with the plant;
            or the period [s] at which the torque is computed and then held. Its state then
            advances by one Euler step a period. A whole multiple of dt.
        torque_limit: "robot" clips each torque to the joint's effort limit as the motors would; an
            array gives other limits [N·m]; None clips nothing. ``Log.saturated`` says where it acted.
        torque_filter: keeps the arm inside its limits, see :class:`TorqueFilter`; control is then sampled at the
            filter's period. ``Log.filter_activity`` says what it did.
        sensors: what shows the controller the forces, each updated at the start of a step (or at its own period)
            and held until the next. By default every needed measurement is the truth, at every instant.
        bodies: what the arm can touch; their states are integrated with the loop. Warns when dt is too long for one.
        scene: what a camera in the hand sees, for laws that need image features; a state that it has is integrated
            with the loop.
        joint_sensor: shows a sampled law q and q̇ with the faults of a :class:`JointSensor`; by default they are the
            truth. ``Log.measured`` has what was shown.
        torque_delay: time from ordering a torque to its acting, of a sampled law [s]; a whole multiple of dt. Until
            the first acts, the arm is held by the torque with which the law's model rests at the start as it is
            shown, clipped like all others. A torque filter does not count with it. ``Log.torque`` is what acts.
        setpoint: what is changed while the run goes on; brought up to date before each step. For one run only.
        progress: show a progress bar; by default only on a terminal.
        watch: called after each sample with the log so far, for instance a ``LiveView``.
        compiled: simulate in C (:func:`compile_law` says what that takes): plant, law, integration and log in one loop.
            What is not compiled (scenes, filters, setpoints, sensors but a momentum observer or a force
            sensor at the joints, bodies but planes,
            spheres and joints) is simulated interpreted, and a CompilationWarning says so.

    Raises:
        InvalidArgumentError: an argument is out of its domain.
        SimulationError: the run diverged or the controller failed; carries the log so far.
        SimulationInterrupted: the run was stopped from the keyboard; carries the log so far.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping.tuned(system, [0.3, 0.2])
        >>> log = simulate(system, law, duration=4.0, dt=5e-3, q0=[0.0, 0.0])
        >>> log.position[-1].round(2), len(log)
        (array([0.3, 0.2]), 801)
    """
    Setpoint.check(setpoint)
    if setpoint is not None and not math.isinf(setpoint.time):
        message = f"has been through a run until {setpoint.time:g} s, and its course is that run's: make a new one"
        raise InvalidArgumentError("setpoint", message)
    if watch is not None and not callable(watch):
        raise InvalidArgumentError("watch", f"must be callable with the log, but is {type(watch).__name__}")
    run = Run(
        system, controller, duration=duration, dt=dt, q0=q0, v0=v0, controller_state0=controller_state0,
        disturbance=disturbance, integrator=integrator, control_period=control_period, torque_limit=torque_limit,
        torque_filter=torque_filter, sensors=sensors, bodies=bodies, scene=scene,
        joint_sensor=joint_sensor, torque_delay=torque_delay,
    )  # fmt: skip
    log = run.log()
    if flag("compiled", compiled):
        others = {"a torque filter": torque_filter, "a setpoint": setpoint, "watch": watch}
        in_c = prepared(run, others)
        if in_c is not None and _run_in_c(in_c, run, log, progress):
            return log
    loop, dt, steps, y = run.loop, run.dt, run.steps, run.start
    sampled, instruments, stride, step = run.sampled, run.instruments, run.stride, INTEGRATORS[run.integrator].step
    disable = None if progress is None else not progress
    done, k, held = 0, 0, NOTHING_HELD
    line, view = TorqueLine(run.late, run.first_torque), None
    encoders = None if run.joint_sensor is None else Encoders(run.joint_sensor)
    try:
        with np.errstate(all="ignore"), tqdm(total=steps, unit="step", disable=disable, delay=0.5, leave=False) as bar:
            for k in range(steps + 1):
                t = k * dt
                if setpoint is not None:
                    setpoint.advance(t)
                if encoders is not None:
                    view = encoders.observe(t, loop.plant_state(y))
                    log.record_joints(k, view)
                if instruments is not None:
                    measured = instruments.observe(k, t, loop, y, held, view)
                    log.record_measured(k, measured)
                    held = held._replace(measured=measured)
                if sampled is not None:
                    if k % stride == 0:
                        y, torque = loop.sample(sampled, t, y, held.measured, view)
                        line.order(k, torque)
                    held = held._replace(torque=line.acting(k))
                elif controller.jumps:
                    y = loop.jump(t, y, held.measured)
                found = loop.evaluate(t, y, held)
                log.record(k, t, y, found)
                if sampled is not None and torque_filter is not None:
                    log.record_filter(k, sampled)
                if watch is not None:
                    watch(log)
                if instruments is not None:
                    instruments.applied(found.torque)
                if k % 100 == 0:
                    bar.update(k - done)
                    done = k
                if k == steps:
                    break
                y = step(loop.during(held), t, y, dt, found.rate)
                if not y.dot(y) < _DIVERGED**2:  # not a number, too
                    raise PHControlError(f"the loop diverged: a state beyond {_DIVERGED:.0e}")
    except SimulationError:
        raise
    except PHControlError as error:
        advice = "" if isinstance(error, ObjectLostError) else f". Try a smaller dt ({dt:g} s) or lower gains"
        message = f"stopped at t = {k * dt:g} s: {error}{advice}"
        raise SimulationError(message, log.truncated()) from error
    except KeyboardInterrupt as error:
        raise SimulationInterrupted(f"interrupted at t = {k * dt:g} s", log.truncated()) from error
    return log


def _run_in_c(found: Prepared, run: Run, log: Log, progress: bool | None) -> bool:
    """Return whether a run was simulated in C, into the log."""
    plan = plan_of(run)
    disable = None if progress is None else not progress
    with tqdm(total=run.steps, unit="step", disable=disable, delay=0.5, leave=False) as bar:

        def sink(first: int, rows: int, record: Any) -> None:
            log.fill(first, run.dt, *(part[:rows, :, 0] for part in record))
            bar.update(first + rows - bar.n)

        done = run_compiled(found, run, plan, sink)
    log.end(run.steps + 1 if done else 0)
    return done
