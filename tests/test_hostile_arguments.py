"""What is no argument at all is refused by its name: no exception of Python or NumPy leaves the doors."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from phcontrol import (
    ControlBox,
    ControlLoop,
    InvalidArgumentError,
    Limits,
    Log,
    LoopLog,
    MechanicalSystem,
    Motion,
    MujocoArm,
    PHControlError,
    SimulatedArm,
    StopVelocity,
    TorqueFilter,
    compare,
    compare_models,
    drive,
    exciting_trajectory,
    identify,
    linearize,
    load_robot,
    make_controller,
    read_loop_log,
    record,
    simulate,
)

NONSENSE = [None, 3, "x", math.nan, [1], object(), -1, [], {}, 1j, b"x"]


@pytest.fixture(scope="module")
def things():
    robot = load_robot("pera_shoulder")
    system = MechanicalSystem(robot)
    law = make_controller("energy_shaping", system, goal=[0.3, 0.5])
    log = simulate(system, law, duration=0.02, progress=False)
    return robot, system, law, log


@pytest.mark.parametrize("nonsense", NONSENSE, ids=lambda value: type(value).__name__)
def test_no_door_lets_a_foreign_exception_out(things, nonsense, tmp_path, monkeypatch):
    """Each is called with something that it cannot use."""
    monkeypatch.chdir(tmp_path)  # b"x" is a path
    robot, system, law, log = things
    page = tmp_path / "page.html"
    calls = {
        "exciting_trajectory robot": lambda: exciting_trajectory(nonsense),
        "compare logs": lambda: compare(nonsense),
        "compare log": lambda: compare({"first": nonsense}),
        "record log": lambda: record(nonsense, page),
        "drive": lambda: drive(nonsense, nonsense, 1.0),
        "identify": lambda: identify(nonsense, ("viscous",), model=robot),
        "LoopLog": lambda: LoopLog(tmp_path / "run.loop", nonsense),
        "MujocoArm": lambda: MujocoArm(nonsense),
    }
    if not isinstance(nonsense, str):
        calls |= {
            "to_mcap path": lambda: log.to_mcap(nonsense),
            "record path": lambda: record(log, nonsense),
            "load_robot source": lambda: load_robot(nonsense),
            "Log.load path": lambda: Log.load(nonsense),
            "read_loop_log path": lambda: read_loop_log(nonsense),
            "exciting_trajectory what": lambda: exciting_trajectory(robot, what=nonsense),
            "identify what": lambda: identify(log, nonsense, model=robot),
            "simulate control_period": lambda: simulate(system, law, duration=0.01, control_period=nonsense or "x"),
        }
    if nonsense is not None:
        calls |= {
            "exciting_trajectory limits": lambda: exciting_trajectory(robot, nonsense),
            "exciting_trajectory frame": lambda: exciting_trajectory(robot, frame=nonsense, what=("viscous",)),
            "record robot": lambda: record(log, page, robot=nonsense),
            "record certificate": lambda: record(log, page, certificate=nonsense),
            "MujocoArm model": lambda: MujocoArm(system, nonsense),
        }
    if not isinstance(nonsense, int):
        calls["exciting_trajectory seed"] = lambda: exciting_trajectory(robot, what=("viscous",), seed=nonsense)
        calls["Linearization.gain"] = lambda: linearize(law, system).gain(nonsense)
    for name, call in calls.items():
        if nonsense == 3 and name == "simulate control_period":
            continue  # a period, though a long one
        with pytest.raises(PHControlError) as caught:
            call()
        assert isinstance(caught.value, (InvalidArgumentError, LookupError)) or name.startswith("MujocoArm"), name


def test_a_path_with_a_nul_is_none(things):
    """ValueError left what writes files."""
    log = things[3]
    for call in (log.save, log.to_mcap, Log.load, read_loop_log, load_robot, lambda path: record(log, path)):
        with pytest.raises(PHControlError):
            call("a\0b")


def test_limits_of_another_arm_are_refused(things):
    with pytest.raises(InvalidArgumentError, match="limits: are of 6 joints, but pera_shoulder has 2"):
        exciting_trajectory(things[0], Limits(MechanicalSystem(load_robot("ur5")), braking_acceleration=1.0))


def test_a_gain_at_no_frequency_is_refused(things):
    _, system, law, _ = things
    found = linearize(law, system)
    for frequency in (math.nan, math.inf, "fast"):
        with pytest.raises(InvalidArgumentError, match="frequency: must be"):
            found.gain(frequency)
    assert found.gain(0.0) == pytest.approx(np.linalg.norm(found.force_output @ np.linalg.solve(-found.A, found.B), 2))


def test_a_drive_that_would_not_end_is_refused(things):
    from tests.runtime.test_loop_log import make_loop

    loop, arm = make_loop()
    with pytest.raises(InvalidArgumentError, match="duration: of 1e.09 s has 1e.12 periods of 0.001 s"):
        drive(loop, arm, 1e9)
    with pytest.raises(InvalidArgumentError, match="driver: NoneType does not say its pace"):
        drive(loop, None, 1.0)
    with pytest.raises(InvalidArgumentError, match="driver: SimpleNamespace has no read: it is no ArmDriver"):
        drive(loop, SimpleNamespace(pace="write", gravity="controller"), 1.0)
    with pytest.raises(InvalidArgumentError, match="each_step: must be a function"):
        drive(loop, arm, 1.0, each_step=3)


@pytest.mark.parametrize("nonsense", [*NONSENSE, np.zeros((2, 2, 2)), 10**400], ids=lambda value: type(value).__name__)
def test_what_a_loop_is_made_of_is_looked_at(things, nonsense):
    """AttributeError, OverflowError and unhashable types left the constructors."""
    _, system, law, _ = things
    box = ControlBox(system, period=1e-3)
    calls = {
        "ControlLoop system": lambda: ControlLoop(nonsense, law, 1e-3),
        "ControlLoop controller": lambda: ControlLoop(system, nonsense, 1e-3),
        "ControlBox": lambda: ControlBox(nonsense, period=1e-3),
        "SimulatedArm": lambda: SimulatedArm(nonsense),
        "Limits": lambda: Limits(nonsense),
        "Limits.franka": lambda: Limits.franka(nonsense),
        "TorqueFilter solver": lambda: TorqueFilter(system, period=1e-3, solver=nonsense),
        "make_controller name": lambda: make_controller(nonsense, system),
    }
    if nonsense is not None:
        calls["SimulatedArm readings"] = lambda: SimulatedArm(box, readings=nonsense)
    for name, call in calls.items():
        with pytest.raises(PHControlError) as caught:
            call()
        assert caught.value, name


def test_numbers_too_large_are_refused(things):
    _, system, law, _ = things
    found = linearize(law, system)
    for call in (
        lambda: ControlLoop(system, law, 1e308),
        lambda: ControlLoop(system, law, 1e-3, stale_after=1e308),
        lambda: StopVelocity(10**400, 1.0),
        lambda: found.sampled(1e-3, delay=10**9),
        lambda: found.step_response(1.0, samples=10**12),
    ):
        with pytest.raises(InvalidArgumentError):
            call()


def test_what_would_not_end_is_refused(things):
    robot, system, _, _ = things
    for call in (
        lambda: exciting_trajectory(robot, what=("viscous",), candidates=10**12),
        lambda: exciting_trajectory(robot, what=("viscous",), harmonics=10**9),
        lambda: exciting_trajectory(robot, what=("viscous",), duration=1e-9),
        lambda: exciting_trajectory(robot, what=("viscous",), duration=1e300),
        lambda: compare_models(robot, robot, samples=10**12),
        lambda: MujocoArm(system, period=1e-3, step=1e-12),
    ):
        with pytest.raises(InvalidArgumentError, match="must be|at most"):
            call()


@pytest.mark.parametrize("which", ["position", "velocity", "torque"])
def test_numbers_that_no_arm_has_are_no_motion(which):
    """Their squares are infinite: LinAlgError left ``identify``, and a contradiction was not seen."""
    signals = {"position": np.zeros((50, 2)), "velocity": np.zeros((50, 2)), "torque": np.zeros((50, 2))}
    signals[which][7, 1] = -1e200
    with pytest.raises(InvalidArgumentError, match=f"{which}: has an entry of 1e.200, which no arm's is"):
        Motion.of(np.linspace(0.0, 1.0, 50), **signals)


def test_a_driver_that_returns_no_reading_is_named():
    """AttributeError left ``drive``."""
    from tests.runtime.test_loop_log import make_loop

    loop, arm = make_loop()
    arm.read = lambda: (0.0, 1.0)
    with pytest.raises(InvalidArgumentError, match="must read a Reading or None, but SimulatedArm read a tuple"):
        drive(loop, arm, 0.01)
