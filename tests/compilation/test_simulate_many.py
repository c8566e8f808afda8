"""Many runs in C are the interpreted runs, each in its lane; what fails is an outcome."""

from __future__ import annotations

import threading
import warnings

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    CompilationWarning,
    EnergyShaping,
    ForceSensor,
    InvalidArgumentError,
    JointContact,
    JointSensor,
    MechanicalSystem,
    MomentumObserver,
    PHControlError,
    RigidBody,
    Sampled,
    Sine,
    StribeckFriction,
    load_robot,
    make_controller,
    simulate,
    simulate_many,
)
from phcontrol.compilation import compiled_loop
from phcontrol.compilation.lanes import LANES
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.simulation import compiled_run
from tests.conftest import make_system

pytestmark = pytest.mark.usefixtures("compiler")

RUNS = LANES + 3  # the second block is not full
RECORDED = ("time", "position", "velocity", "torque", "controller_state", "body_state", "external_force")


@pytest.fixture(autouse=True)
def nothing_is_said(request):
    """A run that is not compiled where it should be is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", CompilationWarning)
        yield


def loaded(k: int) -> MechanicalSystem:
    """Return an arm of its own payload, friction and gravity."""
    friction = StribeckFriction(viscous=0.3 + 0.01 * k, coulomb=0.05 * (k + 1), static=0.1 * (k + 1))
    system = MechanicalSystem(load_robot("pera_shoulder"), friction=friction, gravity=(0.0, 0.0, -9.81 + 0.1 * k))
    hand = system.model.inertias[2]
    heavier = pin.Inertia(hand.mass + 0.1 * k, hand.lever * (1.0 + 0.05 * k), hand.inertia * (1.0 + 0.2 * k))
    for model in (system.model, system.weightless_model):
        model.inertias[2] = heavier
    system.data = system.model.createData()
    return system


def sweep(shoulder, rng, runs=RUNS):
    """Return arguments that differ in everything that may differ within one compilation."""
    law = make_controller("force_feedback_measured", shoulder, goal=[0.4, 0.6])
    table = Sampled([0.0, 0.1, 0.2], [[0.0, 0.0], [1.0, -1.0], [0.0, 0.5]])
    disturbances = [None, [0.5, -0.5], Sine([0.5, 0.2], 3.0), 2.0 * table]
    return {
        "system": [loaded(k) for k in range(runs)],
        "controller": [law.changed(stiffness=10.0 + k, goal=[0.4, 0.6 - 0.02 * k]) for k in range(runs)],
        "q0": shoulder.robot.home + 0.1 * rng.normal(size=(runs, 2)),
        "v0": 0.2 * rng.normal(size=(runs, 2)),
        "disturbance": [disturbances[k % 4] for k in range(runs)],
    }


def compare(outcomes, arguments, every=1, atol=1e-10, **options):
    """Check runs against ``simulate``."""
    for k, outcome in list(enumerate(outcomes))[::every]:
        own = {name: value[k] for name, value in arguments.items()}
        expected = simulate(own.pop("system"), own.pop("controller"), **own, **options)
        assert outcome.number == k
        assert outcome.error == ""
        assert outcome.compiled
        for name in RECORDED:
            found = getattr(outcome.value, name)
            np.testing.assert_allclose(found, getattr(expected, name), rtol=0.0, atol=atol, err_msg=f"{name} of {k}")


@pytest.mark.parametrize(
    "options",
    [{}, {"control_period": 2e-3}, {"integrator": "semi_implicit_euler"}, {"integrator": "discrete_gradient"}],
    ids=["rk4", "sampled", "euler", "discrete gradient"],
)
def test_runs_that_differ_in_all_that_is_a_number(options, shoulder, rng):
    arguments = sweep(shoulder, rng)
    outcomes = simulate_many(**arguments, duration=0.2, **options)
    compare(outcomes, arguments, duration=0.2, **options)
    ends = np.array([outcome.value.position[-1] for outcome in outcomes])
    assert np.ptp(ends, axis=0).min() > 0.05  # they are different runs


def test_only_what_runs_together_takes_all_lanes(shoulder, monkeypatch):
    """A run by itself is one lane, not as much work as a block; one that is left over goes in the block's code."""
    law, asked = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6]), []
    make = compiled_loop.CompiledLoop.block

    def block(self, numbers, lanes):
        made = make(self, numbers, lanes)
        asked.append((made.lanes, len(numbers)))
        return made

    monkeypatch.setattr(compiled_loop.CompiledLoop, "block", block)
    for runs, expected in ((1, [(1, 1)]), (2, [(LANES, LANES)]), (LANES + 1, 2 * [(LANES, LANES)])):
        simulate_many(shoulder, law, q0=np.zeros((runs, 2)), duration=0.01)  # so that it is compiled
        asked.clear()
        simulate_many(shoulder, law, q0=np.zeros((runs, 2)), duration=0.01)
        assert asked[-len(expected) :] == expected  # before them where it starts is looked at
    simulate(shoulder, law, duration=0.01, compiled=True)
    asked.clear()
    simulate(shoulder, law, duration=0.01, compiled=True)
    assert asked[-1] == (1, 1)


def test_one_compilation_serves_a_sweep(shoulder, rng, monkeypatch):
    arguments = sweep(shoulder, rng)
    simulate_many(**arguments, duration=0.02)
    known = list(compiled_run._LOOPS)
    other = sweep(shoulder, np.random.default_rng(7))
    other["controller"] = [law.changed(damping=5.0) for law in other["controller"]]
    monkeypatch.setattr("phcontrol.compilation.compiled_loop.trace_law", lambda *_: pytest.fail("traced again"))
    compare(simulate_many(**other, duration=0.1), other, every=4, duration=0.1)
    assert known == compiled_run._LOOPS


def test_lanes_are_the_runs_by_themselves_to_the_last_bit(shoulder, rng):
    arguments = sweep(shoulder, rng) | {"system": [shoulder] * RUNS}
    outcomes = simulate_many(**arguments, duration=0.2)
    for k in range(0, RUNS, 3):
        own = {name: value[k] for name, value in arguments.items()}
        alone = simulate(own.pop("system"), own.pop("controller"), **own, duration=0.2, compiled=True)
        for name in RECORDED:
            np.testing.assert_array_equal(getattr(outcomes[k].value, name), getattr(alone, name), err_msg=name)


def test_an_observer_and_bodies(shoulder, rng):
    home = shoulder.robot.home
    law = make_controller("force_feedback_measured", shoulder, goal=home + 0.3)
    walls = [
        [RigidBody(JointContact(shoulder.robot.joint_names[1], home[1] + 0.05 + 0.01 * k, side="above"),
                   stiffness=100.0 + 10.0 * k, damping=1.0)]
        for k in range(RUNS)
    ]  # fmt: skip
    arguments = {"system": [shoulder] * RUNS, "controller": [law] * RUNS, "bodies": walls}
    options = {"duration": 0.3, "dt": 5e-4, "sensors": [MomentumObserver(shoulder, 40.0)]}
    outcomes = simulate_many(shoulder, law, bodies=walls, **options)
    compare(outcomes, arguments, every=3, **options)
    assert min(outcome.value.contact_force.max() for outcome in outcomes) > 0.1


def test_what_is_asked_of_runs(shoulder, rng):
    arguments = sweep(shoulder, rng)
    logs = simulate_many(**arguments, duration=0.7)
    ends = simulate_many(**arguments, duration=0.7, measure="final_state", workers=2)
    threads = set()

    def peak(log):
        threads.add(threading.current_thread())
        return float(np.abs(log.torque).max())

    peaks = simulate_many(**arguments, duration=0.7, measure=peak, workers=1)
    for log, end, most in zip(logs, ends, peaks, strict=True):
        last = [log.value.position[-1], log.value.velocity[-1], log.value.controller_state[-1]]
        np.testing.assert_array_equal(end.value, np.concatenate(last))
        assert most.value == np.abs(log.value.torque).max()
    assert threads == {threading.main_thread()}  # a system serves one thread


def test_a_run_that_fails_is_an_outcome(shoulder):
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    laws = [law] * RUNS
    laws[4] = law.changed(damping=5e4)
    q0 = np.tile(shoulder.robot.home, (RUNS, 1))
    q0[6, 0] = np.nan
    options = {"q0": q0, "duration": 0.3, "torque_limit": None}
    for measure in ("log", "final_state", lambda log: log.time[-1]):
        outcomes = simulate_many(shoulder, laws, measure=measure, **options)
        assert [outcome.number for outcome in outcomes if outcome.error] == [4, 6]
        assert outcomes[4].error.startswith("stopped at t = 0.0")
        assert "the loop diverged. Try a smaller dt (0.001 s) or lower gains" in outcomes[4].error
        assert outcomes[6].error == "q0: must be finite, but is nan at index 0"
        assert (outcomes[4].value is None) == (measure != "log")
    log = simulate_many(shoulder, laws, **options)[4].value
    assert 1 < len(log) < 300
    assert np.isfinite(log.position).all()


def test_a_measure_that_fails_is_an_outcome(shoulder):
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    q0 = np.array([[0.0, 0.0], [0.1, 0.1]])
    with np.errstate(all="raise"):
        failed, fine = simulate_many(shoulder, law, q0=q0, duration=0.02, measure=lambda log: 1.0 / log.position[0, 0])
    assert failed.error.startswith("the measure failed: FloatingPointError")
    assert fine.value == pytest.approx(10.0)


class Late(EnergyShaping):
    """Takes a branch that none of the instants shows at which laws are traced, if it is told to."""

    name = "late"
    late = True

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        if x.position[0] > 0.2 and 0.05 < t < 0.1:
            return shaping._replace(effort=0.5 * shaping.effort)
        return shaping


def test_runs_with_sensors_of_their_own(shoulder, rng):
    """Each run has its noise, whatever the others have: in blocks, and alone."""
    arguments = sweep(shoulder, rng)
    sensors = [
        [ForceSensor(noise=0.1 * (k % 3), bias=0.05 * k, delay=1e-3 * k, period=[None, 2e-3][k % 2], seed=k)]
        for k in range(RUNS)
    ]
    arguments["sensors"] = sensors
    outcomes = simulate_many(**arguments, duration=0.2, control_period=1e-3)
    compare(outcomes, arguments, duration=0.2, control_period=1e-3)
    shown = np.array([outcome.value.measured["external_force"] for outcome in outcomes])
    assert len({row.tobytes() for row in shown}) == RUNS
    alone = simulate_many(**{name: value[4:6] for name, value in arguments.items()}, duration=0.2, control_period=1e-3)
    np.testing.assert_allclose(alone[1].value.measured["external_force"], shown[5], rtol=0.0, atol=1e-10)


def joint_sensors():
    """Return one for each run, with faults and delays of its own."""
    return [
        JointSensor(
            position_noise=1e-3 * (k % 3), position_bias=1e-3 * k, velocity_noise=[0.0, 0.01 * k], delay=1e-3 * (k % 5),
            position_resolution=1e-4 * (k % 2), seed=k,
        )
        for k in range(RUNS)
    ]  # fmt: skip


@pytest.mark.parametrize("forces", [False, True])
def test_joint_sensors_that_differ(forces, shoulder, rng):
    arguments = sweep(shoulder, rng) | {"joint_sensor": joint_sensors()}
    if forces:
        arguments["sensors"] = [[ForceSensor(noise=0.1, seed=k)] for k in range(RUNS)]
    options = {"duration": 0.2, "control_period": 2e-3, "torque_delay": 5e-3}
    outcomes = simulate_many(**arguments, **options)
    compare(outcomes, arguments, **options)
    for k, outcome in enumerate(outcomes):
        own = {name: value[k] for name, value in arguments.items()}
        expected = simulate(own.pop("system"), own.pop("controller"), **own, **options)
        for name, shown in expected.measured.items():
            np.testing.assert_allclose(outcome.value.measured[name], shown, rtol=0.0, atol=1e-10, err_msg=name)
    shown = {outcome.value.measured["position"].tobytes() for outcome in outcomes}
    assert len(shown) == RUNS


def test_what_is_on_its_way_outlives_the_record_of_a_final_state(shoulder, rng):
    """No trajectory is kept; readings and torques on their way go on from one part of it to the next."""
    arguments = sweep(shoulder, rng) | {"joint_sensor": joint_sensors()}
    options = {"duration": 1.2, "control_period": 3e-3, "torque_delay": 7e-3}
    found = simulate_many(**arguments, measure="final_state", **options)
    logs = simulate_many(**arguments, **options)
    for outcome, log in zip(found, logs, strict=True):
        np.testing.assert_array_equal(outcome.value[:2], log.value.position[-1])
    compare(logs, arguments, every=5, **options)


def test_joint_sensors_are_checked(shoulder):
    law = make_controller("energy_shaping", shoulder)
    with pytest.raises(InvalidArgumentError, match="joint_sensor: must hold JointSensors, but number 1 is NoneType"):
        simulate_many(shoulder, law, joint_sensor=[JointSensor(), None], control_period=1e-3, duration=0.1)
    with pytest.raises(InvalidArgumentError, match="joint_sensor: must be a JointSensor or a sequence of them"):
        simulate_many(shoulder, law, joint_sensor=0.1, control_period=1e-3, duration=0.1)
    sensors = [JointSensor(), JointSensor(position_bias=[0.1, 0.2, 0.3])]
    good, bad = simulate_many(shoulder, law, joint_sensor=sensors, control_period=1e-3, duration=0.1)
    assert good.error == ""
    assert "position_bias: must have shape (2,)" in bad.error
    (outcome,) = simulate_many(shoulder, law, joint_sensor=JointSensor(), duration=0.1)
    assert "joint_sensor: is of a sampled law" in outcome.error


def test_observers_that_look_at_other_times(shoulder, rng):
    arguments = sweep(shoulder, rng, runs=4)
    arguments["sensors"] = [[MomentumObserver(shoulder, 40.0, period=period)] for period in (None, 2e-3, 4e-3, 2e-3)]
    compare(simulate_many(**arguments, duration=0.1), arguments, duration=0.1)


def test_a_sensor_that_does_not_fit_is_an_outcome(shoulder):
    law = make_controller("force_feedback_measured", shoulder)
    sensors = [[ForceSensor(noise=0.1)], [ForceSensor(noise=[0.1, 0.2, 0.3])]]
    with pytest.warns(CompilationWarning, match="1 of 2 runs"):
        good, bad = simulate_many(shoulder, law, sensors=sensors, duration=0.05)
    assert good.error == ""
    assert "noise: must be a scalar or have shape (2,)" in bad.error


def test_runs_that_take_a_branch_that_is_not_compiled_are_simulated_interpreted(shoulder):
    law = Late.tuned(shoulder, goal=[0.0, 0.6])
    q0 = np.array([[0.0, 0.5], [0.4, 0.5], [0.1, 0.5]])
    with pytest.warns(CompilationWarning, match="1 of 3 runs are simulated interpreted: it takes a branch"):
        outcomes = simulate_many(shoulder, law, q0=q0, duration=0.12)
    assert [outcome.compiled for outcome in outcomes] == [True, False, True]
    for outcome, position in zip(outcomes, q0, strict=True):
        expected = simulate(shoulder, law, q0=position, duration=0.12)
        np.testing.assert_allclose(outcome.value.position, expected.position, rtol=0.0, atol=1e-12)


def test_what_is_not_compiled_is_said_once(shoulder, monkeypatch):
    law = make_controller("force_feedback_measured", shoulder, goal=[0.4, 0.6])
    options = {"q0": np.zeros((3, 2)), "duration": 0.02}
    with pytest.warns(CompilationWarning, match="3 of 3 runs are simulated interpreted: sensors: not") as said:
        outcomes = simulate_many(shoulder, law, sensors=[ForceSensor(frame=shoulder.hand_frame)], **options)
    assert len(said) == 1
    assert not any(outcome.compiled or outcome.error for outcome in outcomes)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(CompilationWarning, match="3 of 3 runs are simulated interpreted: no C compiler") as said:
        simulate_many(shoulder, law, **options)
    assert len(said) == 1


def test_laws_of_two_kinds_are_two_compilations(shoulder):
    laws = [
        make_controller(name, shoulder, goal=[0.4, 0.6])
        for name in ("energy_shaping", "force_feedback", "energy_shaping", "force_feedback")
    ]
    arguments = {"system": [shoulder] * 4, "controller": laws}
    compare(simulate_many(shoulder, laws, duration=0.1), arguments, duration=0.1)


def test_a_compiler_that_fails(shoulder, tmp_path, monkeypatch):
    script = tmp_path / "broken-cc"
    words = "echo 'law.c:1: error: no room' >&2; exit 1"
    script.write_text(f'#!/bin/sh\nif [ "$1" = --version ]; then echo broken 1.0; exit 0; fi\n{words}\n')
    script.chmod(0o755)
    monkeypatch.setenv("CC", str(script))
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    with pytest.warns(CompilationWarning, match="2 of 2 runs are simulated interpreted: the compiler .* failed:"):
        outcomes = simulate_many(shoulder, law, q0=np.zeros((2, 2)), duration=0.02)
    assert not any(outcome.compiled for outcome in outcomes)


def test_a_corrupt_file_of_the_cache_is_made_anew(shoulder, tmp_path, monkeypatch):
    monkeypatch.setenv("PHCONTROL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(compiled_run, "_LOOPS", [])
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    options = {"q0": np.zeros((2, 2)), "duration": 0.02}
    before = simulate_many(shoulder, law, **options)
    for path in (tmp_path / "cache").glob("*.so"):
        path.unlink()  # it is in use: not written into
        path.write_bytes(b"no code")
        path.chmod(0o600)
    monkeypatch.setattr(compiled_run, "_LOOPS", [])
    with pytest.warns(CompilationWarning, match="is refused and made anew: its content is not what was written"):
        after = simulate_many(shoulder, law, **options)
    np.testing.assert_array_equal(after[1].value.position, before[1].value.position)


def test_bad_input_is_refused(shoulder):
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    for words, options in {
        "controller: is for 2 runs, but q0 for 3": {"controller": [law, law], "q0": np.zeros((3, 2))},
        "controller: must hold Controllers, but number 1 is int": {"controller": [law, 3]},
        "controller: is empty": {"controller": []},
        "system: must be a MechanicalSystem or a sequence of them, but is str": {"system": "panda"},
        "q0: must have shape": {"q0": np.zeros((2, 2, 2))},
        "unknown measure 'peak'": {"measure": "peak"},
        "workers: ": {"workers": 0},
        "unknown integrator 'rk5'": {"integrator": "rk5"},
        "duration: ": {"duration": -1.0},
    }.items():
        arguments = {"system": shoulder, "controller": law, "duration": 0.1} | options
        with pytest.raises(PHControlError, match=f"^{words}") as caught:
            simulate_many(**arguments)
        assert str(caught.value).startswith(words)


def test_a_run_that_is_wrong_at_its_start_is_refused(shoulder, monkeypatch):
    """Numbers in another order than they were compiled for are seen where a run begins."""
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    simulate_many(shoulder, law, q0=np.zeros((2, 2)), duration=0.02)
    numbers = compiled_loop.numbers_of_arrangement
    monkeypatch.setattr(compiled_loop, "numbers_of_arrangement", lambda arrangement: numbers(arrangement)[::-1].copy())
    with pytest.warns(CompilationWarning, match="runs are simulated interpreted: the loop as compiled is refused"):
        outcomes = simulate_many(shoulder, law, q0=np.zeros((2, 2)), duration=0.02)
    assert not any(outcome.compiled for outcome in outcomes)


QUICK = [("tracking", "canonical"), ("integral_action", "coriolis"), ("total_force_rejection", "coriolis")]


@pytest.mark.parametrize(("name", "form"), QUICK)
def test_a_few_laws_in_lanes(name, form, shoulder, rng):
    in_lanes(shoulder, make_controller(name, shoulder, interconnection=form), rng)


@pytest.mark.study
@pytest.mark.parametrize("arm", ["pera_gripper", "pera_shoulder_elbow", "panda"])
@pytest.mark.parametrize("name", [name for name, entry in CONTROLLERS.items() if entry.law.run == "position"])
def test_every_law_in_lanes(name, arm, rng):
    system = make_system(arm)
    for form in CONTROLLERS[name].law.forms:
        in_lanes(system, make_controller(name, system, interconnection=form, goal=system.robot.near_home()), rng)


def in_lanes(system, law, rng):
    """Check that runs in lanes are the interpreted ones, and to 1e-13 the compiled ones by themselves."""
    q0 = system.robot.near_home() + 0.05 * rng.normal(size=(3, system.n))
    options = {"duration": 0.1, "dt": 5e-4, "disturbance": 0.1 * rng.normal(size=system.n)}
    outcomes = simulate_many(system, law, q0=q0, **options)
    compare(outcomes, {"system": [system] * 3, "controller": [law] * 3, "q0": q0}, every=2, **options)
    alone = simulate(system, law, q0=q0[1], compiled=True, **options)
    np.testing.assert_allclose(outcomes[1].value.position, alone.position, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(outcomes[1].value.velocity, alone.velocity, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("start", [0.0, 0.03])
def test_a_disturbance_that_raises_is_one_failed_run(compiled, start):
    """It ended all runs."""

    def breaks(t, x):
        if t >= start:
            raise ZeroDivisionError("of my own")
        return np.zeros(2)

    arm = MechanicalSystem(load_robot("pera_shoulder"))
    law = make_controller("energy_shaping", arm, goal=[0.3, 0.5])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CompilationWarning)
        found = simulate_many(arm, law, duration=0.05, disturbance=[None, breaks, None], compiled=compiled)
    assert [bool(outcome.error) for outcome in found] == [False, True, False]
    assert found[1].value is None
    assert "ZeroDivisionError in breaks, line" in found[1].error
    assert "of my own" in found[1].error
    assert found[2].value.position.shape == (51, 2)


@pytest.mark.parametrize("compiled", [False, True])
def test_a_law_that_raises_is_one_failed_run(compiled):
    """It ended all runs where it was traced."""

    class Raising(EnergyShaping):
        def shape(self, *_, **__):
            raise RuntimeError("of my own")

    arm = MechanicalSystem(load_robot("pera_shoulder"))
    laws = [kind.tuned(arm, goal=[0.3, 0.5]) for kind in (EnergyShaping, Raising, EnergyShaping)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CompilationWarning)
        found = simulate_many(arm, laws, duration=0.02, compiled=compiled)
    assert [bool(outcome.error) for outcome in found] == [False, True, False]
    assert "RuntimeError in shape, line" in found[1].error


def test_runs_of_endless_steps_are_refused():
    arm = MechanicalSystem(load_robot("pera_shoulder"))
    law = make_controller("energy_shaping", arm, goal=[0.3, 0.5])
    for run in (simulate_many, simulate):
        for dt, duration in ((1e-300, 1.0), (1e-9, 2.0), (1e-3, 1e9)):
            with pytest.raises(InvalidArgumentError, match="dt: = .* s makes .* steps of .*; a run has at most 1e"):
                run(arm, law, dt=dt, duration=duration)
