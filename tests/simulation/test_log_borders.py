"""Logs at their borders: of no sample, of too many, written to, forged by a hair; balances of nothing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from phcontrol import (
    DataFileError,
    EnergyShaping,
    ExternalAction,
    InvalidArgumentError,
    Log,
    MechanicalSystem,
    load_robot,
    make_controller,
    simulate,
    with_tank,
)
from phcontrol.simulation.power_balance import PowerBalance
from tests.conftest import make_system
from tests.log_files import contents, sealed


@pytest.fixture(scope="module")
def short():
    system = MechanicalSystem(load_robot("pera_shoulder"))
    return simulate(system, make_controller("force_feedback", system), duration=0.01, dt=1e-3, q0=[0.1, 0.2])


@pytest.fixture
def arrays(short, tmp_path):
    return contents(short.save(tmp_path / "log.npz"))


def refused(tmp_path, arrays, match):
    np.savez(tmp_path / "forged.npz", **arrays)
    with pytest.raises(DataFileError, match=match):
        Log.load(tmp_path / "forged.npz")


def test_a_balance_at_rest_is_exact():
    time, none = np.linspace(0.0, 1.0, 5), np.zeros(5)
    still = PowerBalance(time, none, none, none, none)
    assert still.relative_residual == 0.0
    assert still.largest_residual == 0.0
    moving = PowerBalance(time, np.array([0.0, 1.0, 2.0, 1.0, 0.0]), none, none, none)  # energy out of nothing
    assert moving.relative_residual == 1.0
    assert moving.largest_residual == 2.0


def test_time_that_runs_back_twice_is_told_where_it_does_first(arrays, tmp_path):
    time = arrays["time"].copy()
    time[[3, 7]] = time[[2, 5]]
    match = r"runs back from 0.002 s to 0.002 s at sample 3|runs back from 0.007"
    refused(tmp_path, sealed(arrays | {"time": time}), match)
    with pytest.raises(DataFileError, match="at sample 3"):
        Log.load(tmp_path / "forged.npz")


def test_what_was_loaded_cannot_be_written_to(short, tmp_path):
    again = Log.load(short.save(tmp_path / "log.npz"))
    for name in ("time", "position", "velocity", "torque", "storage"):
        array = getattr(again, name)
        np.testing.assert_array_equal(array, getattr(short, name))
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize("value", [0, 0.0, -1e-12, float("inf"), True, "1"])
@pytest.mark.parametrize("key", ["dt", "control_period"])
def test_steps_that_are_none_are_refused(arrays, tmp_path, key, value):
    refused(tmp_path, sealed(arrays, **{key: value}), f"'{key}' of its metadata")


@pytest.mark.parametrize("limit", [0.0, float("inf")])
def test_limits_that_are_none_are_refused(arrays, tmp_path, limit):
    refused(tmp_path, sealed(arrays, torque_limit=[1.0, limit]), "'torque_limit' of its metadata must be")


@pytest.mark.parametrize("metadata", [[], "text", 3, None, {"format": "phcontrol"}])
def test_metadata_that_are_no_table_are_refused(arrays, tmp_path, metadata):
    text = np.frombuffer(json.dumps(metadata).encode(), dtype=np.uint8)
    refused(tmp_path, arrays | {"metadata": text}, "not of format")


@pytest.mark.parametrize("samples", [10**16, 10**18, 10**30])  # beyond addresses, beyond an array, beyond an integer
def test_more_samples_than_there_is_room_for_are_refused(short, samples):
    with pytest.raises(InvalidArgumentError, match="duration: and dt ask for more samples than there is room for"):
        Log.empty(short._loop, samples, 2, 0, [], {})


def test_a_log_of_which_nothing_is_written_yet_holds_no_sample(short, tmp_path):
    loop = short._loop
    log = Log.empty(loop, 3, 2, 0, ["external_force"], {"robot": "pera_shoulder"})
    assert len(log) == 0
    for at_once in (False, True):
        with pytest.raises(DataFileError, match="this log holds no sample"):
            log.save(tmp_path / "none.npz", at_once=at_once)
    assert not (tmp_path / "none.npz").exists()
    assert log.position.shape == (3, 2)
    assert log.controller_state.shape == (3, 2)
    y = np.arange(6.0)
    log.record(0, 0.5, y, loop.evaluate(0.0, short_state(short)))
    assert len(log) == 1
    np.testing.assert_array_equal(log.position[0], y[:2])
    np.testing.assert_array_equal(log.velocity[0], y[2:4])
    np.testing.assert_array_equal(log.controller_state[0], y[4:])
    assert log.truncated().time.tolist() == [0.5]


def test_states_of_bodies_come_after_those_of_the_law(short):
    log = Log.empty(short._loop, 2, 2, 3, [], {})
    y = np.arange(9.0)
    log.record(0, 0.0, y, short._loop.evaluate(0.0, short_state(short)))
    np.testing.assert_array_equal(log.controller_state[0], y[4:6])
    np.testing.assert_array_equal(log.body_state[0], y[6:])
    assert log.body_state.shape == (2, 3)


def test_a_law_without_a_tank_has_no_level_and_one_with_a_tank_has_its(short):
    assert short.tank_level is None
    system = make_system("pera_shoulder")
    stir = ExternalAction(lambda t, x: 0.3 * np.cos(x.position))
    law = with_tank(EnergyShaping).tuned(system, actions=[stir])
    log = simulate(system, law, duration=0.01, dt=1e-3, q0=[0.1, 0.2])
    charge = log.controller_state[:, -1] + np.sqrt(2.0 * law.tank.initial)
    np.testing.assert_allclose(log.tank_level, 0.5 * charge**2, rtol=1e-14)


def short_state(log):
    """The state of its first sample, as the loop takes it."""
    return np.concatenate([log.position[0], log.velocity[0], log.controller_state[0]])


def test_a_run_of_one_step_has_two_samples():
    system = make_system("pera_shoulder")
    log = simulate(system, make_controller("energy_shaping", system), duration=1e-3, dt=1e-3, q0=[0.1, 0.2])
    assert len(log) == 2
    np.testing.assert_array_equal(log.time, [0.0, 1e-3])
    np.testing.assert_array_equal(log.position[0], [0.1, 0.2])
