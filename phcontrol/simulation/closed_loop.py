"""Plant and controller in closed loop, with fixed steps."""

from __future__ import annotations

import math
import platform
import warnings
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from tqdm import tqdm

from phcontrol._validation import Array, choice, flag, per_joint, positive, sequence, vector, whole_multiple
from phcontrol._version import __version__
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.environments.body import Body
from phcontrol.exceptions import (
    InvalidArgumentError,
    ObjectLostError,
    PHControlError,
)
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety.torque_filter import TorqueFilter
from phcontrol.sensors.sensor import Sensor
from phcontrol.setpoints.setpoint import Setpoint
from phcontrol.simulation.compiled_run import Prepared, prepared, run_compiled
from phcontrol.simulation.instruments import Instruments, due_of
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import Log
from phcontrol.simulation.sampled_control import SampledControl, check_filter
from phcontrol.simulation.simulation_error import SimulationError, SimulationInterrupted
from phcontrol.simulation.vector_field import NOTHING_HELD, ClosedLoop, ExternalForce
from phcontrol.vision.scene import Scene

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
        setpoint: what is changed while the run goes on; brought up to date before each step. For one run only.
        progress: show a progress bar; by default only on a terminal.
        watch: called after each sample with the log so far, for instance a ``LiveView``.
        compiled: simulate in C (:func:`compile_law` says what that takes): plant, law, integration and log in one loop.
            What is not compiled (scenes, filters, setpoints, sensors but a momentum observer, bodies but planes,
            spheres and joints) is simulated interpreted, and a CompilationWarning says so.

    Raises:
        InvalidArgumentError: an argument is out of its domain.
        SimulationError: the run diverged or the controller failed; carries the log so far.
        SimulationInterrupted: the run was stopped from the keyboard; carries the log so far.
    """
    check_loop(controller, system)
    dt, duration = positive("dt", dt), positive("duration", duration)
    bodies = sequence("bodies", bodies, "bodies")
    if sensors is not None:
        sensors = sequence("sensors", sensors, "sensors", "quantity", "period", "start", "update", "reading")
    if scene is not None and not hasattr(scene, "state_size"):
        raise InvalidArgumentError("scene", f"must be a Scene, but is {type(scene).__name__}")
    Setpoint.check(setpoint)
    if setpoint is not None and not math.isinf(setpoint.time):
        message = f"has been through a run until {setpoint.time:g} s, and its course is that run's: make a new one"
        raise InvalidArgumentError("setpoint", message)
    if watch is not None and not callable(watch):
        raise InvalidArgumentError("watch", f"must be callable with the log, but is {type(watch).__name__}")
    step = INTEGRATORS[choice("integrator", integrator, INTEGRATORS)].step
    if controller.system.n != system.n:
        raise InvalidArgumentError("controller", f"is for {controller.system.n} joints, the system has {system.n}")
    position = vector("q0", system.robot.home if q0 is None else q0, system.n)
    velocity = vector("v0", np.zeros(system.n) if v0 is None else v0, system.n)
    state = controller.initial_state(controller.system.at(position, velocity))
    if controller_state0 is not None:
        state = vector("controller_state0", controller_state0, state.size)
    if torque_filter is not None:
        check_filter(torque_filter, controller, control_period)
        control_period = torque_filter.period
        torque_filter.reset()
    loop = ClosedLoop(
        system,
        controller,
        _disturbance(disturbance, system.n),
        torque_limit_of(torque_limit, system),
        bodies,
        scene,
    )
    sampled = (
        None if control_period is None else SampledControl(controller, control_period, loop.torque_limit, torque_filter)
    )
    _check_scene(controller, scene, sensors)
    body_state = _check_bodies(bodies, system.at(position, velocity), dt, integrator)
    scene_state = np.zeros(0) if scene is None else scene.initial_state()
    instruments = None if sensors is None else Instruments(sensors, dt)
    stride = 0 if control_period is None else whole_multiple("control_period", control_period, dt)
    steps = max(1, math.ceil(min(duration / dt, 1e300) - 1e-9))
    log = Log.empty(
        loop,
        steps + 1,
        state.size,
        body_state.size + scene_state.size,
        [] if instruments is None else [sensor.quantity for sensor in instruments.sensors],
        {
            "robot": system.robot.name,
            "controller": controller.name,
            "interconnection": controller.interconnection,
            "joint_names": list(system.robot.joint_names),
            "robot_record": system.robot.record(),
            "bodies": [body.record() for body in bodies],
            "seeds": {sensor.quantity: sensor.seed for sensor in sensors or () if hasattr(sensor, "seed")},
            "sight": _sight(loop),
            "wrench_frames": [wrench.frame for wrench in loop.wrenches],
            "dt": dt,
            "integrator": integrator,
            "control_period": control_period,
            "versions": {"phcontrol": __version__, "pinocchio": pin.__version__, "numpy": np.__version__,
                         "python": platform.python_version()},
        },
        filtered=torque_filter is not None,
    )  # fmt: skip
    y = np.concatenate([position, velocity, state, body_state, scene_state])
    if flag("compiled", compiled):
        others = {"a torque filter": torque_filter, "a setpoint": setpoint, "watch": watch}
        found = prepared(loop, integrator, sensors, steps * dt, others)
        if found is not None and _run_in_c(found, loop, log, y, dt, steps, integrator, stride, sensors, progress):
            return log
    disable = None if progress is None else not progress
    done, k, held = 0, 0, NOTHING_HELD
    try:
        with np.errstate(all="ignore"), tqdm(total=steps, unit="step", disable=disable, delay=0.5, leave=False) as bar:
            for k in range(steps + 1):
                t = k * dt
                if setpoint is not None:
                    setpoint.advance(t)
                if instruments is not None:
                    measured = instruments.observe(k, t, loop, y, held)
                    log.record_measured(k, measured)
                    held = held._replace(measured=measured)
                if sampled is not None and k % stride == 0:
                    y, torque = loop.sample(sampled, t, y, held.measured)
                    held = held._replace(torque=torque)
                elif sampled is None and controller.jumps:
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
                if not math.isfinite(y.dot(y)):
                    raise PHControlError("the state is no longer finite: the loop diverged")
    except SimulationError:
        raise
    except PHControlError as error:
        advice = "" if isinstance(error, ObjectLostError) else f". Try a smaller dt ({dt:g} s) or lower gains"
        message = f"stopped at t = {k * dt:g} s: {error}{advice}"
        raise SimulationError(message, log.truncated()) from error
    except KeyboardInterrupt as error:
        raise SimulationInterrupted(f"interrupted at t = {k * dt:g} s", log.truncated()) from error
    return log


def _run_in_c(
    found: Prepared,
    loop: ClosedLoop,
    log: Log,
    y: Array,
    dt: float,
    steps: int,
    integrator: str,
    stride: int,
    sensors: Sequence[Sensor] | None,
    progress: bool | None,
) -> bool:
    """Return whether a run was simulated in C, from y, into the log."""
    from phcontrol.compilation.compiled_loop import Plan

    plan = Plan(steps, dt, integrator, stride, stride * dt, due_of(sensors, dt))
    disable = None if progress is None else not progress
    with tqdm(total=steps, unit="step", disable=disable, delay=0.5, leave=False) as bar:

        def sink(first: int, rows: int, record: Any) -> None:
            log.fill(first, dt, *(part[:rows, :, 0] for part in record))
            bar.update(first + rows - bar.n)

        done = run_compiled(found, loop, y, plan, bool(sensors), sink)
    log.end(steps + 1 if done else 0)
    return done


def _disturbance(value: Any, n: int) -> ExternalForce | Array | None:
    if value is None or callable(value):
        return value  # type: ignore[no-any-return]
    return vector("disturbance", value, n)


def torque_limit_of(value: Any, system: MechanicalSystem) -> Array | None:
    """Return the torque limits that an argument asks for [N·m]; None for none."""
    if value is None:
        return None
    if isinstance(value, str):
        choice("torque limit", value, ["robot"])
        limit = np.asarray(system.robot.effort_limit)
    else:
        limit = per_joint("torque_limit", value, system.n)
        if (limit <= 0.0).any():
            raise InvalidArgumentError("torque_limit", "must be > 0")
    return None if np.isinf(limit).all() else limit


def _sight(loop: ClosedLoop) -> dict[str, Any] | None:
    """Return what a viewer needs of the camera, of what it looks at, and of the law that steers by it."""
    camera = getattr(loop.scene, "camera", None)
    if camera is None:
        return None
    eyes = loop.controller.eyes
    seen = getattr(loop.scene, "record", None)
    return {
        "camera": camera.mounted_on(loop.plant.robot).record(),
        "object": None if seen is None else seen(),
        "goal": None if eyes is None else eyes.goal.tolist(),
    }


def _check_scene(controller: Controller, scene: Scene | None, sensors: Sequence[Sensor] | None) -> None:
    shown = any(sensor.quantity == "features" for sensor in sensors or ())
    if "features" in controller.needs and scene is None and not shown:
        raise InvalidArgumentError(
            "scene", f"{controller.name} needs image features: say what there is to see, scene=ObservedObject(...)"
        )


def _check_bodies(bodies: Sequence[Body], x: MechanicalState, dt: float, integrator: str) -> Array:
    """Return the bodies' states at rest. Refuse a body that starts inside the arm; warn of a step too long."""
    fastest = 0.0
    for number_, body in enumerate(bodies):
        if not isinstance(body, Body):
            raise InvalidArgumentError("bodies", f"must hold bodies, but number {number_} is {type(body).__name__}")
        depth = -body.geometry.gap(x).distance
        if depth > 1e-9:
            raise InvalidArgumentError(
                "bodies", f"number {number_} starts inside the arm, {depth:.3g} deep: move it or q0"
            )
        fastest = max(fastest, body.fastest_rate(x))
    reach = INTEGRATORS[integrator].stability
    if fastest * dt > reach:
        longest = reach / fastest
        message = (
            f"dt = {dt:g} s is too long for the stiffest body: with {integrator} at most {longest:.2g} s is stable"
        )
        warnings.warn(message, stacklevel=3)
    return np.concatenate([np.zeros(0), *(body.initial_state() for body in bodies)])
