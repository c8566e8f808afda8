"""Signals for other programs: every component of each, under its own name, with nothing but the numbers of the run."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from phcontrol import make_controller, simulate
from phcontrol.simulation.signals import Signal, Signals, _plain
from tests.conftest import make_system

TIME = np.array([0.0, 0.1, 0.2])
JOINTS = ("shoulder", "elbow")


@pytest.fixture
def signals():
    table = np.arange(6.0).reshape(3, 2)
    return Signals(
        TIME,
        {
            "position": Signal(table, "rad", JOINTS),
            "state": Signal(np.hstack([table, table[:, :1]]), "1"),
            "energy": Signal(np.array([3.0, 2.0, 1.0]), "J"),
        },
        {"robot": "arm"},
    )


def test_xarray_names_joints_and_numbers_what_has_no_names(signals):
    pytest.importorskip("xarray", reason="needs xarray: pip install 'phcontrol[xarray]'")
    data = signals.to_xarray()
    assert data.position.dims == ("time", "joint")
    assert tuple(data.joint.values) == JOINTS
    assert data.state.dims == ("time", "state_component")
    assert tuple(data.state_component.values) == ("0", "1", "2")
    assert data.energy.dims == ("time",)
    for name, signal in signals.quantities.items():
        np.testing.assert_array_equal(data[name], signal.values)
        assert data[name].attrs["units"] == signal.unit
    np.testing.assert_array_equal(data.time, TIME)


def test_rerun_is_given_a_curve_for_each_component(signals, tmp_path, monkeypatch):
    """By a stand-in for rerun that keeps what it is given."""
    curves, labels = {}, {}

    class Stream:
        def __init__(self, name):
            assert name == "run"

        def save(self, path):
            self.path = path

        def log(self, place, lines, static):
            labels[place] = lines
            assert static

        def send_columns(self, place, indexes, columns):
            assert indexes == [("time", TIME.tolist())]
            curves[place] = columns

        def flush(self):
            with open(self.path, "wb") as file:
                file.write(b"kept")

        def disconnect(self):
            return

    module = SimpleNamespace(
        RecordingStream=Stream,
        TimeColumn=lambda name, duration: (name, duration.tolist()),
        SeriesLines=lambda names: names,
        Scalars=SimpleNamespace(columns=lambda scalars: scalars.tolist()),
    )
    monkeypatch.setitem(sys.modules, "rerun", module)
    path = signals.to_rerun(tmp_path / "run.rrd", "run")
    assert path.read_bytes() == b"kept"
    expected = {"energy": [3.0, 2.0, 1.0]}
    for name, parts in (("position", JOINTS), ("state", ("0", "1", "2"))):
        for k, part in enumerate(parts):
            expected[f"{name}/{part}"] = signals.quantities[name].values[:, k].tolist()
    assert curves == expected
    assert labels["position/elbow"] == "elbow [rad]"
    assert labels["energy"] == "energy [J]"
    assert labels.keys() == curves.keys()


def test_a_log_gives_what_has_one_number_a_sample_beside_its_joints():
    system = make_system("pera_shoulder")
    log = simulate(system, make_controller("energy_shaping", system), duration=0.01, dt=1e-3, q0=[0.1, 0.2])
    found = log.signals.quantities
    for name in ("position", "velocity", "torque", "external_force"):
        np.testing.assert_array_equal(found[name].values, getattr(log, name))
        assert found[name].labels == tuple(system.robot.joint_names)
    for name, unit in (("storage", "J"), ("kinetic_energy", "J"), ("friction_power", "W"), ("supplied_power", "W")):
        assert found[name].values.shape == (len(log),)
        assert found[name].unit == unit
    np.testing.assert_allclose(found["storage"].values, log.storage)
    assert all(signal.values.ndim == 1 for name, signal in found.items() if not signal.labels)


def test_attributes_are_what_files_can_hold():
    """Text and numbers as they are, all else as JSON."""
    assert [_plain(value) for value in ("arm", 3, 0.5)] == ["arm", 3, 0.5]
    assert [_plain(value) for value in (None, [1, 2], {"a": 1.5})] == ["null", "[1, 2]", '{"a": 1.5}']
