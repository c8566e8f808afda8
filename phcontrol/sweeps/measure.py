"""What is measured of a run."""

from __future__ import annotations

import importlib
import inspect
import math
import pickle
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.certify import certify
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, PHControlError, UnknownNameError
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.log import Log
from phcontrol.sweeps.nominal import Nominal

SETTLED = 0.02
"""Of a joint's way: how near its goal it has settled."""
_STATES = 15  # of a certificate without runs


class Measure(NamedTuple):
    """A number of each run; the larger, the worse."""

    unit: str
    meaning: str
    of_log: Callable[[Log, Robot, Array], float] | None = None
    """Of log, arm and goal."""
    of_loop: Callable[[Controller, MechanicalSystem], float] | None = None
    """Of the law and the plant, without a run."""
    needs_goal: bool = False


def final_error(log: Log, robot: Robot, goal: Array) -> float:
    """Return the largest error of a joint at the end [rad]."""
    return float(np.abs(robot.difference(log.position[-1], goal)).max())


def overshoot(log: Log, robot: Robot, goal: Array) -> float:
    """Return how far a joint goes beyond its goal, over its way, of those with a tenth of the longest way or more."""
    way = robot.difference(goal, log.position[0])
    longest = float(np.abs(way).max())
    if not longest > 0.0:
        return 0.0
    moved = np.abs(way) >= 0.1 * longest
    beyond = (robot.difference(log.position, goal) * np.sign(way))[:, moved].max(axis=0)
    return float((np.maximum(0.0, beyond) / np.abs(way[moved])).max())


def settling_time(log: Log, robot: Robot, goal: Array) -> float:
    """Return from when all joints stay within 2 % of the longest way [s]; infinite where they do not to the end."""
    error = np.abs(robot.difference(log.position, goal)).max(axis=1)
    outside = np.flatnonzero(error > SETTLED * error[0])
    if not outside.size:
        return 0.0
    return float(log.time[outside[-1] + 1]) if outside[-1] + 1 < len(log) else math.inf


def peak_torque(log: Log, robot: Robot, goal: Array) -> float:
    """Return the largest torque over its joint's limit."""
    return _largest(np.abs(log.torque), robot.effort_limit)


def peak_velocity(log: Log, robot: Robot, goal: Array) -> float:
    """Return the largest speed over its joint's limit."""
    return _largest(np.abs(log.velocity), robot.velocity_limit)


def peak_position(log: Log, robot: Robot, goal: Array) -> float:
    """Return how far a joint goes from the middle of its range, over half the range: 1 at a limit."""
    middle, half = 0.5 * (robot.lower + robot.upper), 0.5 * (robot.upper - robot.lower)
    bounded = np.isfinite(half) & (half > 0.0)
    if not bounded.any():
        return 0.0
    return float((np.abs(log.position - middle)[:, bounded] / half[bounded]).max())


def saturation(log: Log, robot: Robot, goal: Array) -> float:
    """Return at which part of the samples a torque limit cut the law's torque."""
    return float(log.saturated.mean())


def storage_growth(log: Log, robot: Robot, goal: Array) -> float:
    """Return the largest rise of H_d above what it had come down to [J]; none where a passive law is left alone."""
    storage = log.storage
    return float((storage - np.minimum.accumulate(storage)).max())


def contact_peak(log: Log, robot: Robot, goal: Array) -> float:
    """Return the largest contact force [N or N·m]."""
    return float(log.contact_force.max())


def certificate_residual(law: Controller, plant: MechanicalSystem) -> float:
    """Return by how much the law's promise is missed on the plant, relatively: its certificate's matching residual."""
    return certify(law.unheld, plant, samples=_STATES).matching_residual


def _largest(values: Array, limit: Array) -> float:
    bounded = np.isfinite(limit) & (limit > 0.0)
    return float((values[:, bounded] / limit[bounded]).max()) if bounded.any() else 0.0


MEASURES = {
    "final_error": Measure("rad", "largest joint error at the end", final_error, needs_goal=True),
    "overshoot": Measure("", "way beyond the goal, over the way there", overshoot, needs_goal=True),
    "settling_time": Measure(
        "s", "until all joints stay within 2 % of the longest way", settling_time, needs_goal=True
    ),
    "peak_torque": Measure("", "largest torque over the motors' limit", peak_torque),
    "peak_velocity": Measure("", "largest speed over the joints' limit", peak_velocity),
    "peak_position": Measure("", "way from the middle of a joint's range, over half the range", peak_position),
    "saturation": Measure("", "part of the samples at which a torque limit acted", saturation),
    "storage_growth": Measure("J", "largest rise of H_d", storage_growth),
    "contact_peak": Measure("N or N·m", "largest contact force", contact_peak),
    "certificate_residual": Measure(
        "", "matching residual on the plant (takes a second)", of_loop=certificate_residual
    ),
}
"""The measures that can be named; others are functions of a log."""


def measures_of(given: Any) -> dict[str, Measure]:
    """Return measures by name: of names, of "module:function", or of functions by name.

    Raises UnknownNameError, listing the built-in ones, and InvalidArgumentError for a function that other processes
    cannot have.
    """
    if isinstance(given, Mapping):
        return {str(name): _own(str(name), function) for name, function in given.items()}
    if isinstance(given, str) or not isinstance(given, (list, tuple)) or not given:
        raise InvalidArgumentError("measures", f"must be a list of names, but is {given!r}")
    found: dict[str, Measure] = {}
    for one in given:
        if callable(one):
            name, measure = getattr(one, "__name__", "measure"), _own("measures", one)
        elif isinstance(one, str) and ":" in one:
            name, measure = one.partition(":")[2], _own(one, _imported(one))
        elif isinstance(one, str) and one in MEASURES:
            name, measure = one, MEASURES[one]
        else:
            raise UnknownNameError("measure", str(one), MEASURES, " (or give 'my_module:my_measure')")
        if name in found:
            raise InvalidArgumentError("measures", f"has '{name}' twice")
        found[name] = measure
    return found


def _own(name: str, function: Any) -> Measure:
    if isinstance(function, str):
        return next(iter(measures_of([function]).values()))
    if not callable(function):
        raise InvalidArgumentError(name, f"must be a function of a log, but is {function!r}")
    return Measure("", " ".join((inspect.getdoc(function) or "").split())[:80], _Adapted(function))


class _Adapted:
    """A user's function of a log alone."""

    def __init__(self, function: Callable[[Log], float]) -> None:
        self.function = function

    def __call__(self, log: Log, robot: Robot, goal: Array) -> float:
        return float(self.function(log))


def _imported(path: str) -> Any:
    module_name, _, name = path.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)  # as for laws
    try:
        module = importlib.import_module(module_name)
    except Exception as error:
        raise InvalidArgumentError(
            "measures", f"'{path}' cannot be imported: {type(error).__name__}: {error}"
        ) from error
    if not hasattr(module, name):
        known = [key for key, value in vars(module).items() if inspect.isfunction(value)]
        raise UnknownNameError("measure", name, known, f" in {module_name}")
    return getattr(module, name)


def record_of(name: str, measure: Measure) -> dict[str, str]:
    """Return what tells a measure from another of its name: for a user's own, where it is and its text."""
    function = measure.of_log
    if not isinstance(function, _Adapted):
        return {"name": name}
    inner = function.function
    if getattr(inner, "__module__", "") == "__main__":
        raise InvalidArgumentError(
            "measures", f"'{name}' is a function of the program itself, which other processes cannot import: put it "
            "into a module of its own"
        )  # fmt: skip
    try:
        pickle.dumps(inner)
    except Exception as error:
        raise InvalidArgumentError("measures", f"'{name}' cannot be sent to other processes: {error}") from error
    try:
        source = inspect.getsource(inner)
    except (OSError, TypeError):
        source = ""
    return {"name": name, "of": f"{inner.__module__}:{getattr(inner, '__qualname__', name)}", "source": source}


def check_measures(measures: Mapping[str, Measure], nominal: Nominal) -> None:
    """Raise InvalidArgumentError where a measure is not for a loop."""
    for name, measure in measures.items():
        if measure.needs_goal and nominal.goal is None:
            raise InvalidArgumentError("measures", f"{name} is of a posture, but {nominal.law.name} goes to none")


def all_of(
    measures: Mapping[str, Measure], log: Log, nominal: Nominal, loop: Mapping[str, Any]
) -> dict[str, float | str]:
    """Return each measure of a run: of its log, and of its law and plant (``Nominal.arguments``)."""
    found = evaluate(measures, log, nominal.robot, nominal.goal) | of_loops(measures, loop)
    return {name: found[name] for name in measures}


def of_loops(measures: Mapping[str, Measure], loop: Mapping[str, Any]) -> dict[str, float | str]:
    """Return the measures that are of law and plant."""
    found: dict[str, float | str] = {}
    for name, measure in measures.items():
        if measure.of_loop is not None:
            try:
                found[name] = float(measure.of_loop(loop["controller"], loop["system"]))
            except Exception as error:
                found[name] = text_of(error)
    return found


def text_of(error: Exception) -> str:
    """Return an error as a row of the results has it."""
    known = isinstance(error, PHControlError)
    return str(error) if known else f"{type(error).__name__}: {error}"


def evaluate(measures: Mapping[str, Measure], log: Log, robot: Robot, goal: Array | None) -> dict[str, float | str]:
    """Return each measure of a log; the text of what it raised, where it did."""
    found: dict[str, float | str] = {}
    posture = np.zeros(robot.n) if goal is None else goal
    for name, measure in measures.items():
        if measure.of_log is None:
            continue
        try:
            found[name] = float(measure.of_log(log, robot, posture))
        except Exception as error:  # a user's function, or a log that is too wild
            found[name] = text_of(error)
    return found
