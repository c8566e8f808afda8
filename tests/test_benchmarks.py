"""What the benchmarks compare is the same thing, and what they write can be compared and shown."""

from __future__ import annotations

import copy
import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import MechanicalSystem

ROOT = Path(__file__).parents[1]
BENCHMARKS = ROOT / "benchmarks"
STEPS = 300


@pytest.fixture
def benchmark_module(monkeypatch):
    """Return a function that imports a module of the benchmarks, beside which the others are found."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module


def written(**changes):
    """Return a run of the suite."""
    rows = {
        "step": {"Slotine-Li, by hand on Pinocchio": {"ratio": 1.0, "µs": 9.0, "p99": 10.0}},
        "simulation": {
            "pin.aba and RK4 by hand, sampled": {"best": 40.0},
            "phcontrol compiled, RK4, sampled": {"best": 240.0},
        },
    }
    rows["step"]["law coriolis"] = {
        "step ratio": 0.2,
        "interpreted ratio": 1.5,
        "operations": 1000,
        "difference": 1e-15,
    }
    run = {"format": 1, "commit": "a", "date": "2026-01-01", "machine": {"processor": "p"}, "parts": rows}
    for path, value in changes.items():
        part, name, key = path.split("__")
        run["parts"][part][name.replace("_", " ")][key.replace("_", " ")] = value
    return run


def test_what_became_slower_is_said(benchmark_module):
    compared = benchmark_module("compare").compared
    assert compared(written(), written(), 0.1) == ([], False)
    lines, slower = compared(written(), written(step__law_coriolis__step_ratio=0.3), 0.1)
    assert slower
    assert lines == ["slower   step | law coriolis | step ratio: 0.2 to 0.3 (+50%)"]
    lines, slower = compared(written(), written(step__law_coriolis__operations=500), 0.1)
    assert not slower
    assert lines == ["faster   step | law coriolis | operations: 1000 to 500 (-50%)"]
    assert compared(written(), written(step__law_coriolis__step_ratio=0.21), 0.1) == ([], False)


def test_simulations_are_compared_with_the_loop_by_hand(benchmark_module):
    """A machine that is twice as fast is no change; one law that is slower on it is."""
    compared, new = benchmark_module("compare").compared, written()
    for row in new["parts"]["simulation"].values():
        row["best"] *= 2.0
    assert compared(written(), new, 0.1) == ([], False)
    new["parts"]["simulation"]["phcontrol compiled, RK4, sampled"]["best"] = 240.0
    lines, slower = compared(written(), new, 0.1)
    assert slower
    assert "phcontrol compiled, RK4, sampled | over the loop by hand: 6 to 3 (-50%)" in lines[0]


def test_what_is_new_or_gone_and_another_machine_are_said(benchmark_module):
    compared, new = benchmark_module("compare").compared, written()
    new["machine"]["processor"] = "q"
    new["parts"]["step"]["other coriolis"] = {"step ratio": 0.1}
    del new["parts"]["step"]["law coriolis"]
    lines, slower = compared(written(), new, 0.1)
    assert lines[0] == "the machines differ: ratios may, too"
    assert "gone     step | law coriolis | step ratio" in lines
    assert "new      step | other coriolis | step ratio: 0.1" in lines
    assert not slower
    assert compared(written(), written() | {"quick": True}, 0.1)[0] == [
        "a quick run is among them, whose times mean nothing"
    ]


def test_the_command_ends_as_it_should(tmp_path):
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    old.write_text(json.dumps(written()))
    command = [sys.executable, str(BENCHMARKS / "compare.py"), str(old), str(new)]
    for run, code in ((written(), 0), (written(step__law_coriolis__step_ratio=0.3), 1)):
        new.write_text(json.dumps(run))
        assert subprocess.run(command, capture_output=True, check=False).returncode == code
    new.write_text(json.dumps(written() | {"format": 2}))
    assert b"run the suite again" in subprocess.run(command, capture_output=True, check=False).stderr


def test_the_page_is_that_of_the_run(benchmark_module):
    """Remade with ``python benchmarks/page.py``."""
    run = json.loads((BENCHMARKS / "results.json").read_text(encoding="utf-8"))
    assert (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8") == benchmark_module("page").page_of(run)
    assert not run["quick"]


@pytest.fixture
def loops(benchmark_module):
    """Return positions of the loop by hand, sampled and continuous, and what is needed to run it elsewhere."""
    system = benchmark_module("arms").panda(friction=False)
    law = benchmark_module("phcontrol").make_controller("energy_shaping", system, system.robot.near_home())
    gains = law.goal, law.stiffness.diagonal(), law.damping.diagonal()
    assert np.array_equal(law.stiffness, np.diag(gains[1]))
    reference = benchmark_module("reference")
    by_hand = reference.energy_shaping(system.model, law.goal, law.stiffness, law.damping)
    q0, v0 = np.array(system.robot.home), np.zeros(system.n)
    runs = [
        reference.closed_loop(system.model, by_hand, q0, v0, 1e-3, STEPS, sampled)["q"] for sampled in (True, False)
    ]
    assert np.abs(runs[0] - q0).max() > 0.05
    return system, gains, by_hand, (q0, v0), runs


def heavier(system):
    """Return a system one of whose links is heavier by a thousandth."""
    other = MechanicalSystem(system.robot, friction=None)
    body = other.model.inertias[4]
    other.model.inertias[4] = pin.Inertia(1.001 * body.mass, body.lever, body.inertia)
    return other


def test_mujoco_runs_the_same_loop(benchmark_module, loops):
    pytest.importorskip("mujoco", reason="mujoco is not installed (extra peers)")
    peer, (system, gains, law, start, (sampled, continuous)) = benchmark_module("peer_mujoco"), loops
    plain, within = peer.model_of(system, 1e-3, "RK4"), peer.model_of(system, 1e-3, "RK4", gains)
    assert np.abs(peer.by_python(plain, law, *start, STEPS, False)["q"] - sampled).max() < 1e-12
    assert np.abs(peer.by_python(plain, law, *start, STEPS, True)["q"] - continuous).max() < 1e-12
    assert np.abs(peer.in_c(within, gains[0], *start, STEPS)["q"] - continuous).max() < 1e-12
    other = peer.model_of(heavier(system), 1e-3, "RK4")
    assert np.abs(peer.by_python(other, law, *start, STEPS, False)["q"] - sampled).max() > 1e-6


def test_drake_runs_the_same_loop(benchmark_module, loops):
    """To what its third order leaves."""
    pytest.importorskip("pydrake", reason="drake is not installed (extra peers)")
    peer, (system, gains, law, start, (sampled, continuous)) = benchmark_module("peer_drake"), loops
    run = peer.simulation_of(system, *gains, 1e-3, law=law)
    assert np.abs(run(*start, STEPS)["q"] - sampled).max() < 1e-7
    run = peer.simulation_of(system, *gains, 1e-3)
    assert np.abs(run(*start, STEPS)["q"] - continuous).max() < 1e-6
    run = peer.simulation_of(heavier(system), *gains, 1e-3, law=law)
    assert np.abs(run(*start, STEPS)["q"] - sampled).max() > 1e-6


def test_a_chain_has_the_joints_it_should(benchmark_module):
    for n in (1, 3, 14):
        assert benchmark_module("arms").chain(n).n == n


def test_runs_are_not_changed_by_being_compared(benchmark_module):
    old, new = written(), written(step__law_coriolis__step_ratio=0.3)
    before = copy.deepcopy((old, new))
    benchmark_module("compare").compared(old, new, 0.1)
    assert (old, new) == before
