"""A run that is going to be simulated: its arguments checked, and what follows from them."""

from __future__ import annotations

import math
import platform
import warnings
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import (
    Array,
    choice,
    instance,
    number,
    per_joint,
    positive,
    sequence,
    vector,
    whole_multiple,
)
from phcontrol._version import __version__
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.environments.body import Body
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety.clipping import clipped
from phcontrol.safety.torque_filter import TorqueFilter
from phcontrol.sensors.joint_sensor import JointSensor
from phcontrol.sensors.sensor import Sensor
from phcontrol.simulation.instruments import Encoders, Instruments
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import JOINTS_SHOWN, Log
from phcontrol.simulation.sampled_control import SampledControl, check_filter
from phcontrol.simulation.vector_field import ClosedLoop, ExternalForce
from phcontrol.vision.scene import Scene

MOST_STEPS = 10**9
"""Of one run: an hour and more of the fastest compiled loop."""


class Run:
    """A plant under a controller from a state on, for a time. The arguments are those of :func:`simulate`.

    Raises what ``simulate`` raises where one is out of its domain.
    """

    def __init__(
        self,
        system: MechanicalSystem,
        controller: Controller,
        *,
        duration: float,
        dt: float,
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
    ) -> None:
        check_loop(controller, system)
        self.dt, duration = positive("dt", dt), positive("duration", duration)
        self.steps = steps_of(duration, self.dt)
        bodies = sequence("bodies", bodies, "bodies")
        if sensors is not None:
            sensors = sequence("sensors", sensors, "sensors", "quantity", "period", "start", "update", "reading")
        if scene is not None and not hasattr(scene, "state_size"):
            raise InvalidArgumentError("scene", f"must be a Scene, but is {type(scene).__name__}")
        self.integrator = choice("integrator", integrator, INTEGRATORS)
        if controller.system.n != system.n:
            raise InvalidArgumentError("controller", f"is for {controller.system.n} joints, the system has {system.n}")
        position = vector("q0", system.robot.home if q0 is None else q0, system.n)
        velocity = vector("v0", np.zeros(system.n) if v0 is None else v0, system.n)
        self.joint_sensor = joint_sensor
        start = system.at(position, velocity)
        if joint_sensor is not None:
            start = Encoders(instance("joint_sensor", joint_sensor, JointSensor)).observe(0.0, start)
        seen = start.seen_by(controller.system)
        state = controller.initial_state(seen)
        if controller_state0 is not None:
            state = vector("controller_state0", controller_state0, state.size)
        if control_period is not None:
            positive("control_period", control_period)
        if torque_filter is not None:
            check_filter(torque_filter, controller, control_period)
            control_period = torque_filter.period
            torque_filter.reset()
        limit = torque_limit_of(torque_limit, system)
        self.loop = ClosedLoop(system, controller, _disturbance(disturbance, system.n), limit, bodies, scene)
        self.control_period, self.filter, self.sensors = control_period, torque_filter, sensors
        self.sampled = (
            None if control_period is None else SampledControl(controller, control_period, limit, torque_filter)
        )
        """The sampled controller; None for a continuous one."""
        self.torque_delay = number("torque_delay", torque_delay, minimum=0.0)
        for name, given in (("joint_sensor", joint_sensor is not None), ("torque_delay", self.torque_delay > 0.0)):
            if given and control_period is None:
                raise InvalidArgumentError(name, "is of a sampled law: give control_period, too")
        late = whole_multiple("torque_delay", self.torque_delay, self.dt) if self.torque_delay else 0
        self.late = min(late, self.steps + 1)
        """Steps from ordering a torque to its acting; more than the run has are one more than that."""
        self.first_torque = np.zeros(system.n) if not late else _holding(seen, limit)
        """What acts until the first that was ordered, shape (n,) [N·m]."""
        _check_scene(controller, scene, sensors)
        body_state = _check_bodies(bodies, system.at(position, velocity), self.dt, integrator)
        scene_state = np.zeros(0) if scene is None else scene.initial_state()
        self.instruments = None if sensors is None else Instruments(sensors, self.dt)
        self.stride = 0 if control_period is None else whole_multiple("control_period", control_period, self.dt)
        """Steps in a control period; 0 for a continuous controller."""
        self.start = np.concatenate([position, velocity, state, body_state, scene_state])
        """y at time 0."""
        self._sizes = state.size, body_state.size + scene_state.size

    def log(self) -> Log:
        """Return a log with room for the run. Raises InvalidArgumentError where there is none for so many samples."""
        loop, sensors = self.loop, self.sensors
        system, controller = loop.plant, loop.controller
        return Log.empty(
            loop,
            self.steps + 1,
            *self._sizes,
            [
                *([] if self.instruments is None else [sensor.quantity for sensor in self.instruments.sensors]),
                *([] if self.joint_sensor is None else JOINTS_SHOWN),
            ],
            {
                "robot": system.robot.name,
                "controller": controller.name,
                "interconnection": controller.interconnection,
                "joint_names": list(system.robot.joint_names),
                "robot_record": system.robot.record(),
                "bodies": [body.record() for body in loop.bodies],
                "seeds": {sensor.quantity: sensor.seed for sensor in sensors or () if hasattr(sensor, "seed")}
                | ({} if self.joint_sensor is None else {"joints": self.joint_sensor.seed}),
                "sight": _sight(loop),
                "wrench_frames": [wrench.frame for wrench in loop.wrenches],
                "dt": self.dt,
                "integrator": self.integrator,
                "control_period": self.control_period,
                "torque_delay": self.torque_delay,
                "versions": {"phcontrol": __version__, "pinocchio": pin.__version__, "numpy": np.__version__,
                             "python": platform.python_version()},
            },
            filtered=self.filter is not None,
        )  # fmt: skip


def _holding(x: MechanicalState, limit: Array | None) -> Array:
    """Return the torque that holds an arm at rest at a state of a model, inside the limits [N·m]."""
    torque = x.motor_torque(x.potential_gradient)
    return torque if limit is None else clipped(torque, -limit, limit)


def _disturbance(value: Any, n: int) -> ExternalForce | Array | None:
    if value is None or callable(value):
        return value  # type: ignore[no-any-return]
    return vector("disturbance", value, n)


def steps_of(duration: float, dt: float) -> int:
    """Return how many steps a run takes. Raises InvalidArgumentError where it would not come to its end."""
    steps = min(duration / dt, 1e300) - 1e-9
    if steps > MOST_STEPS:
        raise InvalidArgumentError(
            "dt", f"= {dt:g} s makes {steps:.2g} steps of {duration:g} s; a run has at most {MOST_STEPS:.0e}"
        )
    return max(1, math.ceil(steps))


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
        warnings.warn(message, stacklevel=4)
    return np.concatenate([np.zeros(0), *(body.initial_state() for body in bodies)])
