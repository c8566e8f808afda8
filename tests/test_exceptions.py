"""Errors go through a pickle as they are: a pool of processes that cannot read one waits for ever."""

from __future__ import annotations

import copy
import importlib
import pickle
import pkgutil
import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import phcontrol
from phcontrol import (
    AnswerError,
    ArmError,
    CompilationError,
    CompilationWarning,
    DataFileError,
    EngineError,
    InvalidArgumentError,
    LawError,
    MissingMeasurementError,
    NonFiniteTorqueError,
    NotTraceableError,
    ObjectLostError,
    PHControlError,
    RobotDescriptionError,
    RobotDescriptionWarning,
    SimulationError,
    SimulationInterrupted,
    UnknownNameError,
    UnreachableTargetError,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.sweeps.chunk import VersionError
from phcontrol.trajectories.inverse_kinematics import Posture
from tests.conftest import make_system


def log():
    system = make_system("pera_shoulder")
    return simulate(system, make_controller("energy_shaping", system), duration=0.01)


EXAMPLES = {
    PHControlError: lambda: PHControlError("something"),
    InvalidArgumentError: lambda: InvalidArgumentError("gain", "must be > 0"),
    AnswerError: lambda: AnswerError(dict, "storage", "returned None, expected a number [J]"),
    LawError: lambda: LawError("law", "law.py:3", ValueError("wrong")),
    UnknownNameError: lambda: UnknownNameError("joint", "elbo", ["elbow", "wrist"], " of arm"),
    RobotDescriptionError: lambda: RobotDescriptionError("arm.urdf, line 3: wrong"),
    MissingMeasurementError: lambda: MissingMeasurementError("law", "force"),
    NonFiniteTorqueError: lambda: NonFiniteTorqueError("law", 0.5, torque=np.array([np.nan, 1.0]), state="x"),
    ObjectLostError: lambda: ObjectLostError("law", 0.5, np.array([0.1, 0.2]), "out of sight"),
    SimulationError: lambda: SimulationError("stopped", log()),
    SimulationInterrupted: lambda: SimulationInterrupted("interrupted", log()),
    UnreachableTargetError: lambda: UnreachableTargetError(
        "tool", "arm", " in row 3", Posture(np.array([0.1, 0.2]), 0.3, 0.4)
    ),
    DataFileError: lambda: DataFileError("cannot read"),
    ArmError: lambda: ArmError("the robot stopped"),
    EngineError: lambda: EngineError("its process was killed"),
    VersionError: lambda: VersionError("a worker has another phcontrol"),
    CompilationError: lambda: CompilationError("the compiler failed"),
    NotTraceableError: lambda: NotTraceableError("law cannot be compiled"),
    CompilationWarning: lambda: CompilationWarning("no C compiler was found"),
    RobotDescriptionWarning: lambda: RobotDescriptionWarning("implausible"),
}


def own_exceptions():
    """Return every public exception class defined in any module of the package: the others never leave it."""
    found = set()
    for module in pkgutil.walk_packages(phcontrol.__path__, "phcontrol."):
        if module.name.endswith("__main__"):
            continue
        for item in vars(importlib.import_module(module.name)).values():
            own = isinstance(item, type) and item.__module__.startswith("phcontrol")
            if own and issubclass(item, BaseException) and not item.__name__.startswith("_"):
                found.add(item)
    return found


def same(a, b):
    """Whether two pieces of evidence are equal: arrays, and what holds them."""
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b, equal_nan=True) if a.dtype.kind == "f" else np.array_equal(a, b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(map(same, a, b))
    if type(a).__module__.startswith("phcontrol") and hasattr(a, "__dict__"):
        return type(a) is type(b) and same(vars(a), vars(b))
    return type(a) is type(b) and (a == b or a != a or type(a).__module__.startswith("pinocchio"))


def test_there_is_an_example_of_each():
    assert own_exceptions() == set(EXAMPLES)


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("how", [*range(pickle.HIGHEST_PROTOCOL + 1), "copy", "deepcopy"])
def test_message_and_evidence_survive(kind, how):
    error = EXAMPLES[kind]()
    again = getattr(copy, how)(error) if isinstance(how, str) else pickle.loads(pickle.dumps(error, how))
    assert type(again) is kind
    assert str(again) == str(error)
    assert again.args == error.args
    assert vars(again).keys() == vars(error).keys()
    assert same(vars(again), vars(error))


def _unknown():
    load_robot("perra")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of forks in a process with threads
def test_an_error_comes_out_of_a_pool_of_processes():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with ProcessPoolExecutor(1) as pool, pytest.raises(UnknownNameError, match="Did you mean 'pera'") as caught:
            pool.submit(_unknown).result(timeout=60)
    assert caught.value.name == "perra"
