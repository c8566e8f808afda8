"""Many runs at once: in the lanes of a vector, and over threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import choice, flag, positive
from phcontrol._validation import count as whole_number
from phcontrol.controllers.controller import Controller
from phcontrol.environments.body import Body
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.joint_sensor import JointSensor
from phcontrol.sensors.sensor import Sensor
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import Log
from phcontrol.simulation.many_runs import MEASURES, ManyRuns
from phcontrol.simulation.outcome import Outcome
from phcontrol.simulation.run import steps_of
from phcontrol.simulation.vector_field import ExternalForce


def simulate_many(
    system: MechanicalSystem | Sequence[MechanicalSystem],
    controller: Controller | Sequence[Controller],
    *,
    duration: float,
    dt: float = 1e-3,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    controller_state0: ArrayLike | None = None,
    disturbance: ExternalForce | ArrayLike | Sequence[ExternalForce | ArrayLike | None] | None = None,
    integrator: str = "rk4",
    control_period: float | None = None,
    torque_limit: Literal["robot"] | ArrayLike | None = "robot",
    sensors: Sequence[Sensor] | Sequence[Sequence[Sensor]] | None = None,
    bodies: Sequence[Body] | Sequence[Sequence[Body]] = (),
    joint_sensor: JointSensor | Sequence[JointSensor] | None = None,
    torque_delay: float = 0.0,
    measure: Literal["log", "final_state"] | Callable[[Log], Any] = "log",
    workers: int | None = None,
    progress: bool | None = None,
    compiled: bool = True,
) -> list[Outcome]:
    """Run many closed loops and return what became of each, in their order.

    ``system``, ``controller``, ``q0``, ``v0``, ``controller_state0``, ``disturbance``, ``sensors``, ``bodies`` and
    ``joint_sensor`` are one for all runs, or a sequence with one for each (of states: an array with a row for each).
    All else is as of :func:`simulate`, and so is each run.

    Loops that differ in numbers only (initial states; gains, goals, tables and single numbers of laws; gravity,
    friction, springs, and inertias of the arms; disturbances; force and joint sensors; contacts) are compiled once and
    together, and go on eight at a time in the lanes of a vector, each to the last bit as by itself, over threads. Only
    the inertias that differ between the runs are inputs of the code. What is not compiled is simulated interpreted, one
    run after the other; a CompilationWarning says so once.

    A run that fails is an outcome with its error, and not the end; so is one whose arguments are refused, or whose law,
    disturbance or sensor raises an error of its own.

    Args:
        system: the plant, or one for each run.
        controller: the law, or one for each run (``law.changed(stiffness=...)``).
        duration: simulated time [s].
        dt: step of the integrator [s].
        q0: initial position [rad], shape (n,) or (runs, n).
        v0: initial velocity [rad/s], likewise.
        controller_state0: the controller's initial state, likewise.
        disturbance: external force f_e [N·m] or a function of time and state, or a sequence of these.
        integrator: a name in ``INTEGRATORS``.
        control_period: see ``simulate``.
        torque_limit: see ``simulate``.
        sensors: see ``simulate``; or a sequence of them for each run (with a seed each, for noise of its own).
        bodies: what the arm can touch, or a sequence of them for each run.
        joint_sensor: see ``simulate``; or a sequence with one for each run (with a seed each).
        torque_delay: see ``simulate``.
        measure: "log" for logs; "final_state" for (q, q̇, controller state, bodies' states) at the end, for which no
            trajectory is kept; or a function of a log, which is let go after it. It is called in this thread.
        workers: threads; by default one for each processor that there is for this process.
        progress: show a progress bar; by default only on a terminal.
        compiled: False simulates all runs interpreted.

    Raises:
        InvalidArgumentError: an argument that all runs share is out of its domain, or sequences differ in length.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, load_robot, make_controller, simulate_many
        >>> arm = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = make_controller("energy_shaping", arm, goal=[0.3, 0.5])
        >>> laws = [law.changed(stiffness=stiffness) for stiffness in (10.0, 20.0)]
        >>> found = simulate_many(arm, laws, duration=0.1, measure="final_state", compiled=False)
        >>> [outcome.value.shape for outcome in found]
        [(4,), (4,)]
    """
    dt, duration = positive("dt", dt), positive("duration", duration)
    steps_of(duration, dt)
    choice("integrator", integrator, INTEGRATORS)
    if not callable(measure):
        choice("measure", measure, MEASURES)
    threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
    if workers is not None:
        threads = whole_number("workers", workers, minimum=1)
    each = {
        "system": _of_kind("system", system, MechanicalSystem),
        "controller": _of_kind("controller", controller, Controller),
        "q0": _rows("q0", q0),
        "v0": _rows("v0", v0),
        "controller_state0": _rows("controller_state0", controller_state0),
        "disturbance": _disturbances(disturbance),
        "sensors": _lists(sensors),
        "bodies": _lists(bodies),
        "joint_sensor": None if joint_sensor is None else _of_kind("joint_sensor", joint_sensor, JointSensor),
    }
    lengths = {name: len(value) for name, value in each.items() if value is not None}
    count = max(lengths.values(), default=1)
    for name, length in lengths.items():
        if length != count:
            longest = next(other for other in lengths if lengths[other] == count)
            raise InvalidArgumentError(name, f"is for {length} runs, but {longest} for {count}")
    common = {
        "system": system, "controller": controller, "q0": q0, "v0": v0, "controller_state0": controller_state0,
        "disturbance": disturbance, "bodies": bodies, "duration": duration, "dt": dt, "integrator": integrator,
        "control_period": control_period, "torque_limit": torque_limit, "sensors": sensors,
        "joint_sensor": joint_sensor, "torque_delay": torque_delay,
    }  # fmt: skip
    varied = {name: value for name, value in each.items() if value is not None}

    def arguments(index: int) -> dict[str, Any]:
        return common | {name: value[index] for name, value in varied.items()}

    return ManyRuns(arguments, count, measure, threads).outcomes(flag("compiled", compiled), progress)


def _of_kind(name: str, value: Any, kind: type) -> list[Any] | None:
    """Return a sequence of things of a kind as a list; None for one for all."""
    if isinstance(value, kind):
        return None
    if isinstance(value, (str, bytes)) or not isinstance(value, Sequence):
        raise InvalidArgumentError(
            name, f"must be a {kind.__name__} or a sequence of them, but is {type(value).__name__}"
        )
    for number, one in enumerate(value):
        if not isinstance(one, kind):
            raise InvalidArgumentError(name, f"must hold {kind.__name__}s, but number {number} is {type(one).__name__}")
    if not value:
        raise InvalidArgumentError(name, "is empty: there is nothing to run")
    return list(value)


def _rows(name: str, value: Any) -> list[Any] | None:
    """Return the rows of an array of two dimensions, or of a list of arrays; None for one for all."""
    if value is None:
        return None
    try:
        depth = np.ndim(value)
    except ValueError:  # rows of different lengths
        depth = 2
    if depth > 2:
        raise InvalidArgumentError(name, f"must have shape (n,) or (runs, n), but has {depth} dimensions")
    return list(value) if depth == 2 else None


def _disturbances(value: Any) -> list[Any] | None:
    if value is None or callable(value):
        return None
    if isinstance(value, (list, tuple)) and any(one is None or callable(one) for one in value):
        return list(value)
    return _rows("disturbance", value)


def _lists(value: Any) -> list[Any] | None:
    if isinstance(value, (list, tuple)) and value and all(isinstance(one, (list, tuple)) for one in value):
        return list(value)
    return None
