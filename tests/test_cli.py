"""The command line as a user sees it: output, files, exit codes, one clear line for each error."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from phcontrol import Log
from phcontrol.cli import app
from phcontrol.controllers.registry import CONTROLLERS, laws_for
from tests.conftest import make_system

QUICK = ["--robot", "pera_shoulder", "--duration", "0.2", "--samples", "3"]


def run(*arguments: str):
    return CliRunner().invoke(app, list(arguments))


def test_run_position_writes_log_picture_and_certificate(tmp_path):
    result = run("run", "position", *QUICK, "--out", str(tmp_path / "out"))
    assert result.exit_code == 0, result.output
    for phrase in ("final error", "storage H_d", "real-time factor", "PASSED", "log.npz", "position.png"):
        assert phrase in result.output
    assert len(Log.load(tmp_path / "out" / "log.npz")) == 201
    assert json.loads((tmp_path / "out" / "certificate.json").read_text())["passed"] is True
    assert (tmp_path / "out" / "position.png").read_bytes().startswith(b"\x89PNG")


def test_options_of_the_run_reach_it(tmp_path):
    result = run(
        "run", "position", *QUICK, "--controller", "energy_shaping", "--interconnection", "canonical",
        "--goal", "shoulder_roll=0.3", "--set", "stiffness=[30, 20]", "--control-period", "0.01",
        "--integrator", "semi_implicit_euler", "--out", str(tmp_path),
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    metadata = Log.load(tmp_path / "log.npz").metadata
    assert metadata["controller"] == "energy_shaping"
    assert metadata["interconnection"] == "canonical"
    assert metadata["control_period"] == 0.01
    assert metadata["integrator"] == "semi_implicit_euler"


@pytest.mark.parametrize("options", [["--camera-rate", "50"], ["--controller", "reduction_servo"]])
def test_run_servo_writes_log_picture_and_certificate(tmp_path, options):
    result = run(
        "run", "servo", "--robot", "pera_shoulder_elbow", "--duration", "4", "--samples", "3", *options,
        "--out", str(tmp_path),
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "largest error of a feature" in result.output
    log = Log.load(tmp_path / "log.npz")
    assert abs(log.features[-1] - [0.0, 0.0, 0.002]).max() < 2e-4
    assert ("features" in log.measured) is ("--camera-rate" in options)
    assert json.loads((tmp_path / "certificate.json").read_text())["passed"] is True
    assert (tmp_path / "servo.png").read_bytes().startswith(b"\x89PNG")


def test_certify_all_as_table_and_as_json():
    table = run("certify", "--robot", "pera_shoulder", "--samples", "3")
    assert table.exit_code == 0, table.output
    applicable = laws_for(make_system("pera_shoulder"))
    assert table.output.count("passed") == 2 * len(applicable)
    assert "hamiltonian_servo is not for this arm: system: has 2 joints" in table.output
    data = run("certify", "--robot", "pera_shoulder", "--samples", "3", "--json")
    rows = json.loads(data.output)
    assert {row["law"] for row in rows} == set(applicable)
    assert all(row["passed"] for row in rows)


def test_a_failed_certificate_is_exit_code_1(monkeypatch):
    from phcontrol import EnergyShaping
    from phcontrol.controllers.registry import Entry

    class Broken(EnergyShaping):
        def shape(self, t, x, state, measured):
            law = super().shape(t, x, state, measured)
            return law._replace(effort=-law.effort)

    monkeypatch.setitem(CONTROLLERS, "broken", Entry(Broken, "broken on purpose", "nowhere"))
    result = run("certify", "--controller", "broken", "--robot", "pera_shoulder", "--samples", "3")
    assert result.exit_code == 1
    assert "FAILED" in result.output


@pytest.mark.parametrize("command", ["robots", "controllers"])
def test_listings(command):
    text, data = run(command), run(command, "--json")
    assert text.exit_code == data.exit_code == 0
    for row in json.loads(data.output):
        assert row["name"] in text.output or row.get("fixed_base") is False


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["certify", "--robot", "perra"], "error: unknown robot 'perra'"),
        (["certify", "--robot", "missing.urdf"], "error: missing.urdf: no such file"),
        (["certify", "--controller", "pid"], "error: unknown controller 'pid'"),
        (["certify", "--interconnection", "fast"], "error: unknown interconnection 'fast'"),
        (["certify", "--samples", "0"], "error: samples: must be an integer >= 1"),
        (["certify", "--robot", "panda", "--lock", "finger"], "error: unknown joint 'finger' of panda"),
        (["run", "position", *QUICK, "--dt", "0"], "error: dt: must be > 0"),
        (["run", "position", *QUICK, "--goal", "1,2,x"], "error: --goal: must be angles"),
        (["run", "position", *QUICK, "--goal", "1,2,3"], "error: position: must have shape (2,)"),
        (["run", "position", *QUICK, "--goal", "elbow=1"], "error: unknown joint 'elbow'"),
        (["run", "position", *QUICK, "--set", "stiffness=-1"], "error: stiffness: must be positive definite"),
        (["run", "position", *QUICK, "--set", "stifness=1"], "Did you mean 'stiffness'?"),
        (["run", "position", *QUICK, "--set", "stiffness=soft"], "error: --set: 'stiffness' must be a number"),
        (["run", "position", *QUICK, "--set", "stiffness"], "error: --set: must be NAME=VALUE"),
        (["run", "position", *QUICK, "--integrator", "euler"], "error: unknown integrator 'euler'"),
        (
            ["run", "position", "--controller", "hamiltonian_servo"],
            "error: controller: hamiltonian_servo steers by an image, not to a posture: use 'run servo'",
        ),
        (["run", "servo", "--controller", "energy_shaping"], "error: unknown servo law 'energy_shaping'"),
        (["run", "servo", "--start", "a,b"], "error: --start: must be numbers like 0,0,0.002"),
        (["run", "servo", "--goal", "0,0"], "error: features: must have shape (3,)"),
        (["certify", "--controller", "hamiltonian_servo", "--robot", "pera_shoulder"], "error: system: has 2 joints"),
        (["certify", "--controller", "reduction_servo", "--set", 'frame="eye"'], "error: unknown frame 'eye' of pera"),
        (["run", "nothing"], "No such command 'nothing'"),
        (["certify", "--wrong"], "No such option: --wrong"),
    ],
)
def test_errors_are_one_clear_line_and_exit_code_2(arguments, complaint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert complaint in result.stderr
    assert "Traceback" not in result.output
    if complaint.startswith("error"):
        assert len(result.stderr.strip().splitlines()) == 1


def test_an_unwritable_place_is_found_before_the_run(tmp_path):
    file = tmp_path / "file"
    file.write_text("in the way")
    result = run("run", "position", "--duration", "1e9", "--out", str(file / "out"))
    assert result.exit_code == 2
    assert "cannot write to --out" in result.stderr


def test_a_full_disk_is_one_clear_line(tmp_path):
    if not os.path.exists("/dev/full"):
        pytest.skip("needs /dev/full")
    # a folder that cannot be made because its parent is a device
    result = run("run", "position", *QUICK, "--out", "/dev/full/out")
    assert result.exit_code == 2
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_diverging_run_keeps_its_log(tmp_path, monkeypatch):
    from phcontrol import EnergyShaping

    def explode(self, t, x, state, measured):
        law = shape(self, t, x, state, measured)
        return law._replace(effort=law.effort * (float("nan") if t > 0.1 else 1.0))

    shape = EnergyShaping.shape
    monkeypatch.setattr(EnergyShaping, "shape", explode)
    result = run("run", "position", *QUICK, "--controller", "energy_shaping", "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "energy_shaping gave a torque that is not finite" in result.stderr
    assert len(Log.load(tmp_path / "log-stopped.npz")) == 101
    assert not (tmp_path / "log.npz").exists()


def test_the_package_loads_neither_plots_nor_viewer_until_needed():
    code = "import sys, phcontrol, phcontrol.cli; print([m for m in ('matplotlib', 'meshcat') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_silence_in_a_pipe(tmp_path):
    command = [sys.executable, "-m", "phcontrol.cli", "run", "position", *QUICK, "--out", str(tmp_path)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stderr == ""
