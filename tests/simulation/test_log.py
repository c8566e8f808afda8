"""Logs: energies that balance, files that survive, and files that are refused."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest

from phcontrol import (
    DataFileError,
    Log,
    MechanicalSystem,
    PHControlError,
    StribeckFriction,
    load_robot,
    make_controller,
)
from phcontrol import simulate as run


@pytest.fixture(scope="module")
def log():
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"), friction=StribeckFriction(viscous=0.5))
    controller = make_controller("force_feedback_measured", system, goal=[0.4, -0.3, 0.5])

    def force(t, x):
        return np.array([np.sin(3.0 * t), 1.0, -np.cos(t)])

    return run(system, controller, duration=1.0, dt=1e-3, disturbance=force, torque_limit=None)


@pytest.mark.parametrize("of", ["storage", "plant"])
def test_power_balances(log, of):
    """Ḣ by differences of the samples equals its parts: fourth order, so 1e-12·H⁽⁵⁾ at 1 ms."""
    balance = log.power_balance(of)
    assert np.abs(balance.supplied).max() > 0.1
    assert np.abs(balance.dissipated).max() > 0.1
    assert balance.relative_residual < 1e-7


def test_the_balance_shows_a_forged_torque(log):
    forged = Log({name: getattr(log, name).copy() for name in recorded}, log.metadata, log._loop)
    forged.torque[400:600] += 0.5
    assert forged.power_balance("plant").largest_residual > 1e-2


recorded = ("time", "position", "velocity", "torque", "external_force", "controller_state", "body_state")


def test_sampling_shows_in_the_balance_of_the_storage_not_of_the_plant(log):
    system, controller = log._loop.plant, log._loop.controller
    sampled = run(system, controller, duration=1.0, dt=1e-3, control_period=2e-2)
    continuous = run(system, controller, duration=1.0, dt=1e-3)
    assert sampled.power_balance().largest_residual > 100 * continuous.power_balance().largest_residual


def test_a_saved_log_is_the_same_log(log, tmp_path):
    path = log.save(tmp_path / "deep" / "log.npz")
    loaded = Log.load(path)
    for name in (*recorded, "storage", "kinetic_energy", "potential_energy", "supplied_power", "dissipated_power"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(log, name))
    assert loaded.metadata["robot"] == "pera_shoulder_elbow"
    assert loaded.power_balance().largest_residual == log.power_balance().largest_residual
    assert [item.name for item in path.parent.iterdir()] == ["log.npz"]  # nothing temporary is left


def test_saturation_survives_saving(tmp_path):
    system = MechanicalSystem(load_robot("pera_shoulder"))
    log = run(system, make_controller("energy_shaping", system, goal=[1.0, 0.5], stiffness=100.0), duration=0.1)
    assert log.saturated.any()
    np.testing.assert_array_equal(Log.load(log.save(tmp_path / "log.npz")).saturated, log.saturated)


def test_a_failed_save_leaves_the_old_file(log, tmp_path, monkeypatch):
    path = log.save(tmp_path / "log.npz")
    before = path.read_bytes()

    def full(file, **data):
        file.write(b"partial")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(DataFileError, match=r"cannot write .*log\.npz: No space left on device"):
        log.save(path)
    assert path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ["log.npz"]


def archive(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def metadata(**content):
    return np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"not a zip file",
        archive(time=np.zeros(3)),
        archive(metadata=metadata(format="phcontrol-log-99"), time=np.zeros(3)),
        archive(metadata=metadata(format="phcontrol-log-1"), time=np.zeros(3)),
        archive(metadata=np.zeros(4, dtype=np.uint8)),
        archive(metadata=metadata(format="phcontrol-log-1"), time=np.array([object()], dtype=object)),
    ],
    ids=["empty", "garbage", "no metadata", "future format", "incomplete", "bad json", "pickle"],
)
def test_files_that_are_no_logs_are_refused(tmp_path, content):
    path = tmp_path / "log.npz"
    path.write_bytes(content)
    with pytest.raises(DataFileError, match="cannot read"):
        Log.load(path)


def test_a_truncated_file_is_refused(log, tmp_path):
    path = log.save(tmp_path / "log.npz")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataFileError, match="cannot read"):
        Log.load(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(DataFileError, match="cannot read"):
        Log.load(tmp_path / "nowhere.npz")


def test_to_dataframe(log):
    frame = log.to_dataframe()
    np.testing.assert_array_equal(frame["position/elbow_pitch"], log.position[:, 2])
    np.testing.assert_array_equal(frame.index, log.time)


def test_too_short_a_log_has_no_power_balance():
    system = MechanicalSystem(load_robot("pera_shoulder"))
    short = run(system, make_controller("energy_shaping", system), duration=2e-3)
    with pytest.raises(PHControlError, match="at least five samples"):
        short.power_balance()
