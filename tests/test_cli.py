"""The command line as a user sees it: output, files, exit codes, one clear line for each error."""

from __future__ import annotations

import importlib
import itertools
import json
import os
import re
import shlex
import shutil
import signal
import socket
import stat
import subprocess
import sys
import urllib.error
import urllib.request
import warnings
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from phcontrol import Log, load_robot
from phcontrol.cli import app, application
from phcontrol.cli.application import Commands
from phcontrol.controllers.registry import CONTROLLERS, laws_for
from tests.browser import run_of
from tests.conftest import make_system

BRIEF = ["--robot", "pera_shoulder", "--samples", "3"]
QUICK = [*BRIEF, "--duration", "0.2"]


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
    assert table.output.count("passed") == sum(len(CONTROLLERS[name].law.forms) for name in applicable)
    assert "hamiltonian_servo is not for this arm: system: has 2 joints" in table.output
    data = run("certify", "--robot", "pera_shoulder", "--samples", "3", "--json")
    rows = json.loads(data.output)
    assert {row["law"] for row in rows} == set(applicable)
    assert all(row["passed"] for row in rows)


@pytest.mark.parametrize(("law", "robot"), list(zip(CONTROLLERS, itertools.cycle(["ur5", "kinova", "panda"]))))
def test_every_law_runs_on_any_robot_without_an_experiment(law, robot, tmp_path):
    quick = ["--duration", "0.05", "--dt", "0.001", "--samples", "2", "--out", str(tmp_path)]
    result = run("run", law, "--robot", robot, *quick)
    assert result.exit_code == 0, result.output
    assert f"on {robot}" in result.output
    log = Log.load(tmp_path / "log.npz")
    assert log.metadata["controller"] == CONTROLLERS[law].law.name
    assert len(log) == 51
    assert np.abs(log.torque).max() > 0.0


def test_options_of_a_law_are_those_of_run_position():
    law, position = run("run", "integral_action", "--help").output, run("run", "position", "--help").output
    for option in ("--robot", "--goal", "--set NAME=VALUE", "--lock JOINT", "--armature", "--out"):
        assert option in law
        assert option in position
    assert "--controller" not in law


@pytest.mark.parametrize(
    "options",
    [
        ["--trajectory", "swing", "--interconnection", "transformed"],
        ["--trajectory", "reach", "--goal", "elbow_joint=0.3", "--speed", "0.9"],
        ["--external-force", "measured", "--push", "elbow_joint=5"],
        ["--external-force", "observed", "--control-period", "0.002", "--armature", "0.1"],
    ],
)
def test_run_track_follows_on_any_arm(options, tmp_path):
    result = run(
        "run", "track", "--robot", "ur5", "--duration", "0.3", "--samples", "2", *options, "--out", str(tmp_path)
    )
    assert result.exit_code == 0, result.output
    assert "asked of it        within the limits of position, velocity and torque" in result.output
    error = float(re.search(r"error on the way +(\S+) rad", result.output)[1])
    assert error < (1e-8 if "observed" not in options else 1e-3)


def test_the_hand_is_put_where_it_should_be(tmp_path):
    result = run(
        "run", "track", "--robot", "ur5", "--trajectory", "reach", "--reach", "0.4,0.2,0.4", "--frame", "tool0",
        "--speed", "1", "--duration", "4", "--dt", "0.004", "--samples", "2", "--out", str(tmp_path),
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    final = Log.load(tmp_path / "log.npz").position[-1]
    np.testing.assert_allclose(load_robot("ur5").placement("tool0", final).translation, [0.4, 0.2, 0.4], atol=1e-5)


def test_run_track_takes_a_motion_from_a_file(tmp_path):
    """Columns in any order when they are named; the arm follows what the file says."""
    path, t = tmp_path / "motion.csv", np.linspace(0.0, 1.0, 21)
    rows = np.column_stack([0.2 * np.sin(t) ** 2, t, 0.1 * t**2])
    path.write_text("shoulder_roll,time,shoulder_pitch\n" + "\n".join(",".join(map(str, row)) for row in rows))
    result = run(
        "run", "track", "--robot", "pera_shoulder", "--trajectory", str(path), "--duration", "0.9", "--samples", "2",
        "--out", str(tmp_path),
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    log = Log.load(tmp_path / "log.npz")
    np.testing.assert_allclose(log.position[-1], [0.1 * 0.81, 0.2 * np.sin(0.9) ** 2], atol=1e-5)


def test_certificates_of_every_arm(monkeypatch):
    """The table of --robot all, on a few arms; one whose description is broken says why it is refused."""
    monkeypatch.setattr("phcontrol.cli.certify.every_arm", lambda: ["pera_shoulder", "tiago_pro", "bravo7_gripper"])
    result = run("certify", "--robot", "all", "--controller", "tracking", "--samples", "2")
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0] == "| robot | joints | law | coriolis | canonical | transformed | verdict |"
    assert lines[2].startswith("| pera_shoulder | 2 | tracking |")
    assert all(line.endswith("| passed |") for line in lines[2:4])
    assert "refused: bravo7_gripper: the mass matrix is not positive definite" in lines[4]
    data = json.loads(run("certify", "--robot", "all", "--samples", "2", "--controller", "tracking", "--json").output)
    assert [row["verdict"] for row in data] == ["passed", "passed", "refused"]


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback", "integral_action", "impedance_grasping"])
def test_run_leads_to_the_goal_within_the_velocity_limits(tmp_path, law):
    """Nothing is left of the error on the way, and no joint is faster than half of its limit."""
    result = run("run", law, "--robot", "ur5", "--duration", "2", "--samples", "3", "--out", str(tmp_path))
    assert result.exit_code == 0, result.output
    log, robot = Log.load(tmp_path / "log.npz"), load_robot("ur5")
    assert (np.abs(log.velocity) <= 0.501 * robot.velocity_limit).all()
    np.testing.assert_allclose(log.position[-1], robot.near_home(), atol=1e-9)
    assert "limits             kept" in result.output
    assert "warning" not in result.output


def test_a_step_is_given_only_when_asked_for_and_a_run_that_leaves_a_limit_is_exit_code_1(tmp_path):
    fingers = ["--lock", "panda_finger_joint1", "--lock", "panda_finger_joint2"]
    quick = ["--duration", "1", "--samples", "3", "--out", str(tmp_path)]
    result = run("run", "force_feedback", "--robot", "panda", *fingers, *quick, "--step")
    assert result.exit_code == 1
    assert "warning: --step: the goal jumps" in result.output
    assert re.search(r"warning: the run left the limits of panda: velocity of panda_joint\d", result.output)
    assert "PASSED" in result.output  # it is not the certificate


def test_a_goal_outside_the_position_limits_is_exit_code_1(tmp_path):
    result = run("run", "energy_shaping", *QUICK[:2], "--goal", "2,0", "--duration", "6", "--samples", "3",
                 "--out", str(tmp_path))  # fmt: skip
    assert result.exit_code == 1
    assert re.search(r"warning: .*position of shoulder_pitch 2 rad at .* limit 1.57", result.output)


def test_a_torque_that_its_limits_cut_is_exit_code_1(tmp_path):
    result = run("run", "energy_shaping", *QUICK, "--step", "--set", "stiffness=1000", "--out", str(tmp_path))
    assert result.exit_code == 1
    assert re.search(r"warning: .*torque limits cut the law's torque at \d+ of 201 samples", result.output)


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


OWN_LAW = """
import numpy as np
from phcontrol import EnergyShaping, InvalidArgumentError, Parameter

class Mine(EnergyShaping):
    "Mine."
    name = "mine"
    label: Parameter = Parameter(default=None, check=lambda name, value, system: value)

    def prepare(self):
        super().prepare()
        print("label", repr(self.label))
        if self.label == "wrong":
            raise InvalidArgumentError("label", "must not be wrong")
        if self.label == "broken":
            self.none.anything

class Broken(Mine):
    def shape(self, t, x, state, measured):
        return x.frame_jacobian("hnad", "local")

class Silent(Mine):
    def storage(self, t, x, state, measured=None):
        return 1.0 / 0

made = 3
"""


@pytest.fixture
def own_law(tmp_path, monkeypatch):
    """A module of the user's in the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", sys.path.copy())
    (tmp_path / "cli_laws.py").write_text(OWN_LAW)
    yield "cli_laws"
    sys.modules.pop("cli_laws", None)


OWN = ["--robot", "pera_shoulder", "--samples", "3"]


def test_a_law_of_ones_own_is_certified_and_run(own_law, tmp_path):
    result = run("certify", "--controller", "cli_laws:Mine", *OWN)
    assert result.exit_code == 0, result.output
    assert result.output.count("passed") == 2
    result = run(
        "run", "position", "--controller", "cli_laws:Mine", *QUICK, "--goal", "0.05,0", "--set", "stiffness=30,20",
        "--out", str(tmp_path / "out"),
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert Log.load(tmp_path / "out" / "log.npz").metadata["controller"] == "mine"


def test_a_law_of_ones_own_is_found_by_the_installed_command(own_law):
    """Its working directory is not on Python's path, as it is with python -m."""
    code = "import sys; sys.path = [p for p in sys.path if p]; from phcontrol.cli import main; main()"
    command = [sys.executable, "-P" if sys.version_info >= (3, 11) else "-s", "-c", code]
    result = subprocess.run(
        [*command, "certify", "--controller", "cli_laws:Mine", *OWN, "--interconnection", "coriolis"],
        capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "PASSED" in result.stdout


@pytest.mark.parametrize(
    ("value", "meant"),
    [
        ("soft", "'soft'"), ("3", "3"), ("-2.5e-1", "-0.25"), ("true", "True"), ("False", "False"), ("None", "None"),
        ("null", "None"), ("1, 2", "[1, 2]"), ("left,right", "['left', 'right']"), ("1,0; 0,.5", "[[1, 0], [0, 0.5]]"),
        ("[1, [2]]", "[1, [2]]"), ('"1,2"', "'1,2'"), ("a b", "'a b'"), ("1_0", "'1_0'"), ("none,1e3", None),
    ],
)  # fmt: skip
def test_what_set_takes(own_law, value, meant):
    result = run("certify", "--controller", "cli_laws:Mine", *OWN, "--set", f"label={value}")
    assert f"label {meant or '[None, 1000.0]'}\n" in result.output


@pytest.mark.parametrize(
    ("arguments", "code", "complaint"),
    [
        (["--controller", "cli_laws:Mine", "--set", "label=wrong"], 2, "error: label: must not be wrong"),
        (["--controller", "cli_laws:Mine", "--set", "label=broken"], 1, "cli_laws:Mine raised AttributeError: 'Mine'"),
        (["--controller", "cli_laws:Mine", "--set", "stiffness=-1"], 2, "error: stiffness: must be positive definite"),
        (["--controller", "cli_laws:Broken"], 1, "unknown frame 'hnad' of pera_shoulder"),
        (["--controller", "cli_laws:Silent"], 1, "ZeroDivisionError"),
        (["--controller", "cli_laws:Min"], 2, "error: unknown law 'Min' in cli_laws. Did you mean 'Mine'?"),
        (["--controller", "cli_laws:made"], 2, "error: controller: 'cli_laws:made' is of type int: give the class"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("command", [["certify"], ["run", "position", "--duration", "0.1"]])
def test_an_error_in_ones_own_law_is_one_line_with_its_place(own_law, command, arguments, code, complaint):
    line = {"broken": "self.none", "Broken": "x.frame_jacobian", "Silent": "1.0 / 0"}
    result = run(*command, *arguments, *OWN, *(["--interconnection", "coriolis"]))
    assert result.exit_code == code, result.output
    assert complaint in result.stderr
    assert "Traceback" not in result.output
    errors = [text for text in result.stderr.splitlines() if text.strip()]
    assert len(errors) == 1
    assert errors[0].startswith("error: ")
    wrong = next((text for key, text in line.items() if any(part.endswith(key) for part in arguments)), None)
    if wrong is not None:
        number = next(k for k, text in enumerate(OWN_LAW.splitlines(), 1) if wrong in text)
        assert f"cli_laws.py:{number}, in " in errors[0]


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("x = (", "cli_laws.py:1: cli_laws:Mine raised SyntaxError: '(' was never closed"),
        (
            "import numpy\nimport numpyy",
            "cli_laws.py:2, in <module>: cli_laws:Mine raised ModuleNotFoundError: No module",
        ),
        ("\n1 / 0", "cli_laws.py:2, in <module>: cli_laws:Mine raised ZeroDivisionError: division by zero"),
    ],
)
def test_a_module_that_cannot_be_imported(own_law, source, complaint):
    Path("cli_laws.py").write_text(source)
    result = run("certify", "--controller", "cli_laws:Mine", *OWN)
    assert result.exit_code == 1
    assert complaint in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_debug_shows_the_traceback(own_law):
    arguments = ["certify", "--controller", "cli_laws:Mine", "--set", "label=broken", *OWN]
    result = run("--debug", *arguments)
    assert type(result.exception).__name__ == "LawError"
    assert isinstance(result.exception.__cause__, AttributeError)
    assert run(*arguments).exit_code == 1


def test_laws_of_installed_packages_are_listed_certified_and_run(own_law, tmp_path):
    info = tmp_path / "own_laws-0.3.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-laws\nVersion: 0.3\n")
    (info / "entry_points.txt").write_text(
        "[phcontrol.controllers]\nmine = cli_laws:Mine\ngone = cli_laws:Gone\nsilent = cli_laws:Silent\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).parents[1])])}

    def command(*arguments):
        line = [sys.executable, "-m", "phcontrol.cli", *arguments]
        return subprocess.run(line, capture_output=True, text=True, check=False, env=environment)

    listed = command("controllers")
    assert "mine\n    Mine\n    from cli_laws; needs q, q̇; of own-laws 0.3\n" in listed.stdout
    assert listed.stderr.startswith("error: controller: 'gone' of own-laws 0.3: unknown law 'Gone' in cli_laws.")
    rows = {row["name"]: row["origin"] for row in json.loads(command("controllers", "--json").stdout)}
    assert rows["mine"] == "own-laws 0.3"
    assert rows["energy_shaping"] == "phcontrol"
    table = command("certify", *OWN)
    assert table.returncode == 1  # of silent
    assert re.search(r"^mine +coriolis .* passed$", table.stdout, re.MULTILINE)
    assert re.search(r"^silent +coriolis .* FAILED$", table.stdout, re.MULTILINE)
    assert "error: silent (coriolis) raised ZeroDivisionError" in table.stderr
    ran = command("run", "mine", *QUICK, "--goal", "0.05,0")
    assert ran.returncode == 0, ran.stderr
    assert "mine (coriolis) on pera_shoulder" in ran.stdout
    assert "law of own-laws 0.3" in command("run", "--help").stdout


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
        (["run", "position", *QUICK, "--goal", "1,2,3"], "error: --goal: must have shape (2,)"),
        (["run", "position", *QUICK, "--goal", "elbow=1"], "error: unknown joint 'elbow'"),
        (["run", "position", *QUICK, "--set", "stiffness=-1"], "error: stiffness: must be positive definite"),
        (["run", "position", *QUICK, "--set", "stifness=1"], "Did you mean 'stiffness'?"),
        (
            ["run", "position", *QUICK, "--set", "stiffness=soft"],
            "error: stiffness: must be an array of real numbers, b",
        ),
        (["run", "position", *QUICK, "--set", "stiffness=1,soft"], "error: --set: 'stiffness' mixes numbers and words"),
        (["run", "position", *QUICK, "--set", "stiffness=1,0;1"], "error: --set: 'stiffness' has rows of 2, 1 entries"),
        (["run", "position", *QUICK, "--set", "stiffness=1,,2"], "error: --set: 'stiffness' has nothing where a value"),
        (["run", "position", *QUICK, "--set", "stiffness="], "error: --set: 'stiffness' is empty"),
        (["run", "position", *QUICK, "--set", "stiffness=[1,"], "error: --set: 'stiffness' is no JSON"),
        (["run", "position", *QUICK, "--set", "stiffness=nan"], "error: stiffness: must be finite"),
        (["run", "position", *QUICK, "--set", "stiffness=1,2,3"], "error: stiffness: must be a scalar, a vector of"),
        (["run", "position", *QUICK, "--set", "damping=None"], "error: damping: must be an array of real numbers"),
        (
            ["certify", "--controller", "no_such_module:Law"],
            "error: controller: 'no_such_module:Law': there is no module",
        ),
        (["certify", "--controller", "laws/mine.py:Law"], "must be a module and a class in it, like laws.mine:Law"),
        (["certify", "--controller", "json:JSONDecoder"], "error: controller: 'json:JSONDecoder' is no Controller"),
        (["certify", "--controller", "json:loads"], "error: controller: 'json:loads' is a function: give the class"),
        (["certify", "--controller", "json:Law"], "error: unknown law 'Law' in json. Known: none."),
        (
            ["certify", "--controller", "phcontrol:Controller"],
            "error: controller: 'phcontrol:Controller' does not state",
        ),
        (["run", "position", *QUICK, "--set", "stiffness"], "error: --set: must be NAME=VALUE"),
        (["run", "position", *QUICK, "--integrator", "euler"], "error: unknown integrator 'euler'"),
        (["run", "track", "--external-force", "felt"], "error: unknown external force 'felt'"),
        (["run", "track", "--trajectory", "missing.csv"], "error: cannot read the trajectory missing.csv"),
        (["run", "track", "--speed", "0"], "error: fraction: must be > 0"),
        (["run", "track", "--push", "elbow=1"], "error: unknown joint 'elbow' of pera"),
        (["run", "tracking", "--armature", "heavy"], "error: --armature: must be numbers like"),
        (["certify", "--robot", "all", "--lock", "x"], "error: --robot: all takes neither --lock"),
        (["run", "track", "--reach", "9,9,9"], "error: frame 'tool' of pera does not reach its target"),
        (["run", "position", "--reach", "9,9"], "error: --reach: must be a point x,y,z"),
        (["run", "position", "--reach", "1,1,1", "--goal", "0"], "error: --reach: and --goal are two goals"),
        (
            ["run", "position", "--controller", "hamiltonian_servo"],
            "error: controller: hamiltonian_servo does not steer to a posture: use 'run servo'",
        ),
        (["run", "servo", "--controller", "energy_shaping"], "error: unknown servo law 'energy_shaping'"),
        (["run", "servo", "--start", "a,b"], "error: --start: must be numbers like 0,0,0.002"),
        (["run", "servo", "--goal", "0,0"], "error: features: must have shape (3,)"),
        (["certify", "--controller", "hamiltonian_servo", "--robot", "pera_shoulder"], "error: system: has 2 joints"),
        (["certify", "--controller", "reduction_servo", "--set", 'frame="eye"'], "error: unknown frame 'eye' of pera"),
        (["run", "position", *QUICK, "--goal", ""], "error: --goal: must be angles"),
        (["run", "position", *QUICK, "--goal", "1_0,0"], "error: --goal: must be angles"),
        (
            ["run", "position", *QUICK, "--goal", "shoulder_roll=1,shoulder_roll=2"],
            "error: --goal: names a joint twice",
        ),
        (["run", "track", "--push", ","], "error: --push: must be numbers"),
        (["run", "servo", "--start", "0,0,1_0"], "error: --start: must be numbers"),
        (["run", "servo", "--start", "0,0,0"], "error: start: must have a length l > 0"),
        (["run", "servo", "--set", 'object_length="x"'], "error: object_length: must be a number"),
        (["run", "servo", "--set", "camera=5"], "error: --set: 'camera' cannot be given on the command line"),
        (["run", "servo", "--set", "goal=[0,0,1]"], "error: --set: 'goal' has an option of its own: use --goal"),
        (["run", "position", *QUICK, "--set", "goal=[1,1]"], "error: --set: 'goal' has an option of its own"),
        (
            ["run", "track", "--set", 'interconnection="coriolis"'],
            "error: --set: 'interconnection' has an option of its",
        ),
        (["run", "position", *QUICK, "--set", "system=1"], "error: --set: 'system' cannot be given"),
        (["run", "position", *QUICK, "--set", "name=1"], "error: --set: 'name' cannot be given"),
        (["run", "position", *QUICK, "--set", "cls=1"], "error: --set: 'cls' cannot be given"),
        (["run", "position", *QUICK, "--set", "stiffness=" + "[" * 100_000], "error: --set: 'stiffness' is no"),
        (["run", "position", *QUICK, "--set", "stiffness=" + "9" * 5000], "error: stiffness: must be finite"),
        (
            ["run", "position", *QUICK, "--set", "stiffness=1", "--set", "stiffness=2"],
            "error: --set: 'stiffness' is given",
        ),
        (
            ["certify", "--controller", "tracking", "--set", "interconnection=1"],
            "error: --set: 'interconnection' has an",
        ),
        (["run", "position", *BRIEF, "--duration", "1e300"], "error: dt: = 0.001 s makes 1e+300 steps"),
        (
            ["run", "position", *BRIEF, "--dt", "1e-300", "--duration", "1e300"],
            "error: dt: = 1e-300 s makes 1e+300 steps",
        ),
        (["run", "position", *QUICK, "--control-period", "nan"], "error: control_period: must be finite"),
        (["run", "position", *QUICK, "--control-period", "0"], "error: control_period: must be > 0"),
        (["run", "position", *QUICK, "--frame", "tool"], "error: --frame: is the frame of --reach"),
        (["run", "position", *QUICK, "--port", "7001"], "error: --port: is the port of --view"),
        (["run", "fig-4-1", "--port", "7001"], "error: --port: is the port of --view"),
        (["run", "position", *QUICK, "--view", "--port", "99999"], "Invalid value for '--port'"),
        (["view", "log.npz", "--port", "65536"], "Invalid value for '--port'"),
        (["view", "log.npz", "--port", "-1"], "Invalid value for '--port'"),
        (["run", "nothing"], "No such command 'nothing'"),
        (["certify", "--wrong"], "No such option"),
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


@pytest.mark.parametrize("option", ["--out", "--record"])
@pytest.mark.parametrize(
    "command", [["run", "position", *QUICK], ["run", "fig-4-1"], ["reproduce", "--only", "fig-2-3"]]
)
def test_no_tree_of_folders_is_made(command, option, tmp_path):
    """A mistyped path is an error before the run: only its last folder is made, and none in the root."""
    if (command[0], option) == ("reproduce", "--record"):
        return
    root = Path("/phcontrol-test-of-folders")
    assert not root.exists()
    end = ["run.html"] if option == "--record" else []
    try:
        for place in (root, root / "deep", tmp_path / "deep" / "deeper"):
            other = [] if option == "--out" or command[0] == "reproduce" else ["--out", str(tmp_path / "out")]
            result = run(*command, *other, option, str(place.joinpath(*end)))
            assert result.exit_code == 2, result.output
            assert result.stderr.startswith(f"error: cannot write {'to --out ' if option == '--out' else ''}{place}")
            assert "there is no folder" in result.stderr
            assert not root.exists()
            assert not (tmp_path / "deep").exists()
    finally:
        shutil.rmtree(root, ignore_errors=True)


def test_below_the_working_directory_folders_are_made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("run", "position", *QUICK, "--record", "pages/today/run.html")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "pages" / "today" / "run.html").exists()
    assert (tmp_path / "results" / "position" / "log.npz").exists()


def test_a_page_replaces_no_pipe_device_or_folder(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for place, what in (("pipe", "a pipe or a device"), (".", "a folder"), ("/dev/full", "a pipe or a device")):
        options = ["--out", str(tmp_path / "out"), "--record", str(tmp_path / place)]
        result = run("run", "position", "--duration", "1e6", *options)
        assert result.exit_code == 2
        assert f"it is {what}" in result.stderr
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_a_trajectory_without_an_end_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path / "pipe", tmp_path, "/dev/zero"):
        result = run("run", "track", "--robot", "pera_shoulder", "--trajectory", str(place))
        assert result.exit_code == 2
        assert "it is a folder, or a pipe or device without an end" in result.stderr


def test_a_users_file_is_not_taken_for_a_probe(tmp_path):
    (tmp_path / ".phcontrol-probe").write_text("mine")
    assert run("run", "position", *QUICK, "--out", str(tmp_path)).exit_code == 0
    assert (tmp_path / ".phcontrol-probe").read_text() == "mine"


def test_a_name_that_is_no_text_is_printed_all_the_same(tmp_path):
    """As a name of another encoding is; nothing is lost after a long run."""
    command = [
        sys.executable,
        "-m",
        "phcontrol.cli",
        "run",
        "position",
        *QUICK,
        "--out",
        os.fsencode(tmp_path) + b"/\xff",
    ]
    result = subprocess.run(command, capture_output=True, check=True)
    assert rb"\udcff/log.npz" in result.stdout
    assert len(Log.load(tmp_path / os.fsdecode(b"\xff") / "log.npz")) == 201


def test_a_terminal_obeys_nothing_that_a_file_says(tmp_path):
    (tmp_path / "motion.csv").write_text("time,\x1b]0;title\x07\n0,1\n")
    result = run("run", "track", "--robot", "pera_shoulder", "--trajectory", str(tmp_path / "motion.csv"))
    assert result.exit_code == 2
    assert result.stderr.startswith("error: cannot read the trajectory")
    assert "\x1b" not in result.stderr
    assert "\x07" not in result.stderr


def test_a_log_is_shown_with_the_meshes_of_the_robot_that_is_given(tmp_path, monkeypatch):
    pages = []
    monkeypatch.setattr("phcontrol.visualization.server.view", lambda page, port=None: pages.append(page))
    assert (
        run("run", "position", "--robot", "ur5", "--lock", "elbow_joint", *QUICK[2:], "--out", str(tmp_path)).exit_code
        == 0
    )
    assert run("view", str(tmp_path / "log.npz")).exit_code == 0
    assert run("view", str(tmp_path / "log.npz"), "--robot", "ur5").exit_code == 0
    assert pages[0] == pages[1]
    wrong = run("view", str(tmp_path / "log.npz"), "--robot", "pera_shoulder")
    assert wrong.exit_code == 2
    assert "unknown joint 'elbow_joint' of pera_shoulder" in wrong.stderr


def test_logs_are_shown_side_by_side_under_what_tells_them_apart(tmp_path, monkeypatch):
    pages = []
    monkeypatch.setattr("phcontrol.visualization.server.view", lambda page, port=None: pages.append(page))
    for folder in ("slow", "fast"):
        assert run("run", "position", *QUICK, "--out", str(tmp_path / folder)).exit_code == 0
    logs = [str(tmp_path / folder / "log.npz") for folder in ("slow", "fast")]
    assert run("view", *logs).exit_code == 0
    assert '"name": "slow"' in run_of(pages[0])
    assert '"name": "fast"' in run_of(pages[0])
    shutil.copy(logs[0], tmp_path / "other.npz")
    written = run("view", logs[0], str(tmp_path / "other.npz"), "--record", str(tmp_path / "both.html"))
    assert written.exit_code == 0
    assert '"name": "other"' in run_of((tmp_path / "both.html").read_text())
    assert len(pages) == 1  # what is recorded is not served
    twice = run("view", logs[0], logs[0])
    assert twice.exit_code == 2
    assert twice.stderr.startswith("error: LOG: is given twice")
    unused = run("view", logs[0], "--record", str(tmp_path / "one.html"), "--port", "7001")
    assert "--port" in unused.stderr
    many = run("view", *logs, *(str(shutil.copy(logs[0], tmp_path / f"{k}.npz")) for k in range(3)))
    assert "must be 1 to 4 runs for a page" in many.stderr


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


def test_a_step_that_is_too_long_is_told_with_one_that_is_not(tmp_path):
    result = run("run", "position", "--robot", "ur5", "--dt", "0.2", "--duration", "3", "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "the loop diverged" in result.stderr
    longest = float(re.search(r"longest stable step here is about (\S+) s", result.stderr)[1])
    assert longest < 0.2
    arguments = ["--dt", f"{0.8 * longest:.4g}", "--duration", "3", "--samples", "3", "--out", str(tmp_path)]
    assert run("run", "position", "--robot", "ur5", *arguments).exit_code == 0


def test_a_run_is_recorded_as_a_page_and_a_log_again(tmp_path):
    page = tmp_path / "pages" / "run.html"
    result = run("run", "position", *QUICK, "--out", str(tmp_path), "--record", str(page))
    assert result.exit_code == 0, result.output
    assert f"recorded {page}" in result.output
    assert "pera_shoulder under force_feedback" in page.read_text()
    study = run("run", "fig-4-1", "--out", str(tmp_path), "--record", str(tmp_path / "ball.html"))
    assert study.exit_code == 0, study.output
    assert {item.name for item in tmp_path.glob("*.html")} == {
        "ball-thesis.html", "ball-feedforward.html", "ball-unlimited.html",
    }  # fmt: skip


def test_view_serves_until_interrupted(tmp_path):
    """The page of the log comes over HTTP, and Ctrl-C ends it as it should be ended."""
    assert run("run", "position", *QUICK, "--out", str(tmp_path)).exit_code == 0
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    for command in (["view", str(tmp_path / "log.npz")], ["run", "position", *QUICK, "--out", str(tmp_path), "--view"]):
        process = subprocess.Popen(
            [sys.executable, "-m", "phcontrol.cli", *command, "--port", "0"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background jobs ignore it
        )  # fmt: skip
        lines = []
        for line in process.stdout:
            lines.append(line)
            if "press Ctrl-C to stop" in line:
                break
        address = re.search(r"http://127\.0\.0\.1:\d+/", lines[0]).group()
        with urllib.request.urlopen(address) as answer:
            assert "pera_shoulder under force_feedback" in answer.read().decode()
        process.send_signal(signal.SIGINT)
        _, complaints = process.communicate(timeout=30)
        assert (process.returncode, complaints) == (0, "")
        with pytest.raises(urllib.error.URLError):
            urllib.request.urlopen(address)


def test_a_taken_port_and_a_missing_log_are_one_clear_line(tmp_path):
    assert run("run", "position", *QUICK, "--out", str(tmp_path)).exit_code == 0
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for arguments in (["view", str(tmp_path / "log.npz")], ["run", "position", *QUICK, "--view"]):
            result = run(*arguments, "--port", port, *(["--out", str(tmp_path)] * (arguments[0] == "run")))
            assert result.exit_code == 2
            assert result.stderr.startswith(f"error: port {port} cannot be used")
            assert len(result.stderr.strip().splitlines()) == 1
    assert run("view", str(tmp_path / "nothing.npz")).stderr.startswith("error: cannot read")


def test_the_package_loads_neither_plots_nor_viewer_until_needed():
    late = ("matplotlib", "meshcat", "trimesh", "tornado")
    code = f"import sys, phcontrol, phcontrol.cli; print([m for m in {late} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_an_interrupt_during_the_imports_is_quiet():
    """It came as a traceback out of typer's modules, when Ctrl-C was pressed in the first half second."""
    code = """
import sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
from phcontrol.cli import main
main()
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (130, "", "")


def test_the_hand_is_named_and_a_finger_is_no_silent_choice(tmp_path):
    """The Panda's hand by default is a finger while fingers move: nothing said that the spring holds it."""
    short = ["--duration", "0.02", "--samples", "3", "--json", "--out", str(tmp_path)]
    finger = run("run", "cartesian_impedance", "--robot", "panda", "--push", "0,0,-1", *short)
    assert json.loads(finger.stdout)["frame"] == "panda_rightfinger"
    locks = ["--lock", "panda_finger_joint1", "--lock", "panda_finger_joint2"]
    assert f"the hand is panda_rightfinger, a finger: {' '.join(locks)} makes" in finger.stderr
    locked = run("run", "cartesian_impedance", "--robot", "panda", "--push", "0,0,-1", *locks, *short)
    assert json.loads(locked.stdout)["frame"] == "panda_hand_tcp"
    asked = run(
        "run", "cartesian_impedance", "--robot", "panda", "--frame", "panda_hand_tcp", "--push", "0,0,-1", *short
    )
    assert json.loads(asked.stdout)["frame"] == "panda_hand_tcp"
    for result in (locked, asked):
        assert "finger:" not in result.stderr
        assert json.loads(result.stdout)["final_turn"] >= 0.0
    spoken = run("run", "cartesian_impedance", "--robot", "ur5", "--push", "0,0,-1", *short[:4], "--out", str(tmp_path))
    assert "mrad of the hand (tool0) after" in spoken.stdout
    assert "finger" not in spoken.output


def test_silence_in_a_pipe(tmp_path):
    command = [sys.executable, "-m", "phcontrol.cli", "run", "position", *QUICK, "--out", str(tmp_path)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stderr == ""


def test_the_list_of_commands_says_what_each_says_itself():
    for name, item in Commands.listed.items():
        module, _, attribute = item.place.partition(":")
        function = getattr(importlib.import_module(module), attribute)
        said = function.info.help if isinstance(function, typer.Typer) else function.__doc__
        assert said.splitlines()[0] == item.summary, name


def test_help_loads_neither_pinocchio_nor_numpy():
    code = (
        "import sys; from phcontrol.cli import app; app(['--help'], standalone_mode=False); "
        "print([m for m in ('numpy', 'pinocchio', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout.endswith("[]\n"), done.stdout + done.stderr


@pytest.mark.parametrize("arguments", [["-h"], ["run", "-h"], ["run", "position", "-h"], ["view", "-h"]])
def test_h_is_help(arguments):
    short, long = run(*arguments), run(*arguments[:-1], "--help")
    assert short.exit_code == 0
    assert short.stdout == long.stdout


def test_quiet_prints_nothing_but_errors(tmp_path):
    done = run("run", "position", "-q", *QUICK, "--out", str(tmp_path))
    assert (done.exit_code, done.stdout) == (0, "")
    assert (tmp_path / "certificate.json").exists()
    refused = run("run", "position", "-q", "--robot", "nowhere")
    assert refused.exit_code == 2
    assert "nowhere" in refused.stderr


def test_an_option_given_twice_is_refused_unless_it_may_be_repeated():
    twice = run("certify", "--robot", "pera", "--robot", "ur5")
    assert twice.exit_code == 2
    assert "'--robot': is given twice" in twice.stderr
    locked = run("certify", "--robot", "pera", "--lock", "wrist_yaw", "--lock", "wrist_pitch", "--samples", "3", "-q")
    assert locked.exit_code == 0, locked.stderr


@pytest.mark.parametrize(
    "command",
    [
        ["position", *QUICK],
        ["energy_shaping", *QUICK],
        ["track", *QUICK],
        ["servo", "--duration", "0.2", "--samples", "3"],
        ["cartesian_impedance", "--duration", "0.05", "--samples", "3", "--set", "posture=none"],
    ],
    ids=" ".join,
)
def test_runs_print_json_and_take_a_seed(command, tmp_path):
    done = run("run", *command, "--json", "--seed", "5", "--out", str(tmp_path))
    content = json.loads(done.stdout)
    assert content["certificate"]["seed"] == 5
    assert content["certificate"] == json.loads((tmp_path / "certificate.json").read_text())
    np.testing.assert_array_equal(content["final_position"], Log.load(tmp_path / "log.npz").position[-1])


def test_a_study_prints_its_claims_as_json(tmp_path):
    done = run("run", "fig-2-3", "--json", "--out", str(tmp_path))
    assert json.loads(done.stdout) == json.loads((tmp_path / "claims.json").read_text())


def test_a_loop_is_analyzed_in_a_table_a_picture_and_json(tmp_path):
    arguments = ["analyze", "--controller", "force_feedback", "--robot", "pera_shoulder", "--differences"]
    picture = tmp_path / "loop.png"
    shown = CliRunner().invoke(app, [*arguments, "--picture", str(picture)])
    assert shown.exit_code == 0, shown.output
    assert "no mode grows" in shown.output
    assert "L₂ gain from f_e: at most" in shown.output
    assert picture.read_bytes().startswith(b"\x89PNG")
    facts = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).output)
    assert len(facts["steps"]) == 2
    assert facts["longest_period"]["0"] > facts["longest_period"]["1"] > 1e-3
    assert all(mode["time_constant"] > 0.0 for mode in facts["modes"])
    assert facts["modes"][0]["time_constant"] == max(mode["time_constant"] for mode in facts["modes"])


def test_what_changes_with_time_is_not_analyzed():
    result = CliRunner().invoke(app, ["analyze", "--controller", "tracking", "--robot", "pera_shoulder"])
    assert result.exit_code == 2
    assert "changes with time" in result.output


def test_designed_gains_are_printed_with_a_command_that_uses_them():
    """What the command then analyses are the modes that were asked for."""
    arguments = ["design", "--controller", "force_feedback", "--robot", "ur5", "--bandwidth", "6"]
    shown = CliRunner().invoke(app, [*arguments, "--damping-ratio", "0.8"])
    assert shown.exit_code == 0, shown.output
    assert "6 × ω = 6 rad/s, ζ = 0.800" in shown.output
    command = shown.output.splitlines()[-1]
    assert command.startswith("phcontrol run position --controller force_feedback --robot ur5 --goal=")
    analysed = shlex.split(command.replace("run position", "analyze") + " --json")[1:]
    facts = json.loads(CliRunner().invoke(app, analysed).output)
    pairs = [mode for mode in facts["modes"] if mode["eigenvalue"][1] > 0.0]
    np.testing.assert_allclose([mode["frequency"] for mode in pairs], 6.0, rtol=1e-4)
    np.testing.assert_allclose([mode["damping_ratio"] for mode in pairs], 0.8, rtol=1e-4)
    as_json = json.loads(CliRunner().invoke(app, [*arguments, "--damping-ratio", "0.8", "--json"]).output)
    assert as_json["command"] == command
    assert as_json["met"]
    assert as_json["modes"][0]["frequency"] == pytest.approx(6.0, rel=1e-3)


def test_gains_are_used_on_the_arm_that_they_were_designed_for():
    """The printed command names rotors, payloads and locked joints as they were given: 5 rad/s on that arm."""
    arm = "--lock wrist_3_joint --armature 0.1 --payload 'mass=2,com=0 0 0.1,frame=tool0'"
    shown = run(*shlex.split(f"design --controller energy_shaping --robot ur5 --bandwidth 5 {arm}"))
    command = shown.output.splitlines()[-1]
    assert f" --robot ur5 {arm} --goal=" in command
    facts = json.loads(run(*shlex.split(command.replace("run position", "analyze"))[1:], "--json").output)
    np.testing.assert_allclose([mode["frequency"] for mode in facts["modes"]], 5.0, rtol=1e-4)


def test_other_specifications_on_the_command_line():
    hand = "design --controller cartesian_impedance --robot ur5 --stiffness 900,900,600,50,50,50 --settling-time 1"
    arm = "design --controller energy_shaping --robot pera_shoulder"
    for line in (hand, f"{arm} --l2-gain 0.1", f"{arm} --torque-share 0.9 --goal 0.1,0.4"):
        shown = CliRunner().invoke(app, shlex.split(line))
        assert shown.exit_code in (0, 1), shown.output
        assert "use them:\nphcontrol" in shown.output
    period = CliRunner().invoke(app, shlex.split("design --controller energy_shaping --robot ur5 --period 0.01"))
    assert "the largest bandwidth is" in period.output


def test_friction_that_damps_more_than_is_desired_is_exit_code_1():
    shown = CliRunner().invoke(app, shlex.split("design --controller energy_shaping --robot pera --bandwidth 5"))
    assert shown.exit_code == 1
    assert "the friction around rest alone damps more" in shown.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("", "--bandwidth: must be given, or one of --settling-time"),
        ("--bandwidth 5 --period 0.001", "--period: is one specification, and --bandwidth another"),
        ("--l2-gain 1 --period 0.001", "--l2-gain: is one specification, and --period another"),
        ("--stiffness 5", "--stiffness: and --settling-time go together"),
        ("--stiffness 5,5 --settling-time 1", "--stiffness: must be 1, 3 or 6 numbers, but are 2"),
        ("--diagonal --period 0.01", "--diagonal: goes with --bandwidth alone"),
        ("--bandwidth -5", "bandwidth: must be > 0"),
        ("--bandwidth 5 --set stiffness=5", "stiffness: is what the poles"),
    ],
)
def test_specifications_that_make_no_sense(options, message):
    line = f"design --controller energy_shaping --robot pera_shoulder {options}"
    shown = CliRunner().invoke(app, shlex.split(line))
    assert shown.exit_code == 2
    assert message in shown.output


SHORT = ["--duration", "0.05", "--samples", "2"]


def test_quiet_says_nothing_beside_json_either(tmp_path):
    """Where results were written stands on stderr beside JSON, and --quiet had left it there."""
    arguments = ["run", "position", "--robot", "pera_shoulder", *SHORT, "--out", str(tmp_path), "--json"]
    assert "wrote" in run(*arguments).stderr
    quiet = run(*arguments, "-q")
    assert (quiet.exit_code, quiet.stdout, quiet.stderr) == (0, "", "")
    assert "wrote" in run(*arguments).stderr  # the next command is not quiet


@pytest.mark.parametrize("name", ["position", "integral_action", "cartesian_impedance", "reduction_servo", "track"])
def test_help_says_where_results_go(name):
    assert f"[default: results/{name}]" in " ".join(run("run", name, "--help").stdout.split())


def test_a_run_in_which_nothing_moves_says_so(tmp_path):
    still = run("run", "cartesian_impedance", "--robot", "ur5", *SHORT, "--out", str(tmp_path))
    assert "nothing moved" in still.stdout
    pushed = run("run", "cartesian_impedance", "--robot", "ur5", "--push", "0,0,5", *SHORT, "--out", str(tmp_path))
    assert "nothing moved" not in pushed.stdout
    assert pushed.stdout.count("\n  limits  ") == 1


def test_a_run_names_the_limits_of_the_arm_once(tmp_path):
    said = run("run", "track", "--robot", "ur5", *SHORT, "--out", str(tmp_path)).stdout
    assert sum(line.strip().startswith("limits") for line in said.splitlines()) == 1
    assert "asked of it" in said


def test_an_arm_of_few_joints_has_a_hand_too(tmp_path):
    """Three joints were refused, since three numbers may be a point or a posture."""
    result = run("run", "cartesian_impedance", "--robot", "pera_shoulder_elbow", *SHORT, "--out", str(tmp_path))
    assert result.exit_code == 0, result.output
    assert "pera_shoulder_elbow has 3 joints, and a pose six directions" in result.stderr


def test_a_servo_at_a_singular_goal_is_refused_not_failed(tmp_path):
    link = (
        '<link name="{0}"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>'
        '<inertia ixx="0.02" iyy="0.02" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j{0}" type="revolute"><parent link="{1}"/><child link="{0}"/><origin xyz="0 0 0.2"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="60" velocity="3"/></joint>'
    )
    links = "".join(link.format(child, parent) for child, parent in (("a", "base"), ("b", "a"), ("c", "b")))
    planar = tmp_path / "planar.urdf"  # stretched at home: it can bring an object nowhere but along one line
    planar.write_text(f'<robot name="planar"><link name="base"/>{links}</robot>')
    for law in ("hamiltonian_servo", "reduction_servo"):
        result = run("certify", "--robot", str(planar), "--controller", law, "--samples", "2")
        assert result.exit_code == 2
        assert "the image Jacobian at the goal is singular there" in result.stderr
    everything = run("certify", "--robot", str(planar), "--samples", "2")
    assert everything.exit_code == 0, everything.output
    assert "hamiltonian_servo is not for this arm" in everything.stdout


def test_analyze_takes_what_an_arm_carries_and_shows_no_rounding(tmp_path):
    arguments = ["analyze", "--controller", "energy_shaping", "--robot", "pera_shoulder", "--set", "damping=5"]
    plain, loaded = (json.loads(run(*arguments, *more, "--json").stdout) for more in ([], ["--payload", "2"]))
    slow = [min(-mode["eigenvalue"][0] for mode in facts["modes"]) for facts in (plain, loaded)]
    assert slow[0] != pytest.approx(slow[1], rel=1e-3)
    assert "--rotor-inertia" in run("analyze", "--help").stdout
    assert "--smoothing" in run("identify", "--help").stdout
    from phcontrol.cli.analyze import lines_of

    row = {"uncertainty": 1e-9, "frequency": 0.0, "damping_ratio": None, "time_constant": None, "joints": {"j": 1.0}}
    facts = plain | {"modes": [row | {"eigenvalue": [1.2e-16, 0.0], "own_states": 0.0}], "steps": []}
    assert lines_of(facts)[2].split()[0] == "0"


def test_a_warning_is_one_line_without_our_code(monkeypatch, capsys):
    """Python would say in which of our files it was made, and print the line of code."""
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
    monkeypatch.setattr(application, "app", lambda: warnings.warn("an arm\nwith a \x1b[1m mesh", UserWarning, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        application.run()
    assert capsys.readouterr().err == "warning: an arm with a ?[1m mesh\n"


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("certify --robot u", {"ur5", "ur10e", "urdf/"}),  # of example-robot-data, of other packages, folders
        ("certify --robot urdf/pera_s", {"urdf/pera_shoulder.urdf", "urdf/pera_shoulder_elbow.urdf"}),
        ("certify --robot al", {"all", "allegro_left_hand"}),
        ("analyze --controller cartesian_t", {"cartesian_tracking"}),
        ("run servo --controller h", {"hamiltonian_servo"}),  # no hand that is held
        ("run position --controller h", set()),
        ("run tracking --interconnection ca", {"canonical"}),
        ("run position --integrator r", {"rk4"}),
    ],
)
def test_a_shell_is_offered_what_an_option_takes(words, offered, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[1])
    line = {"COMP_WORDS": f"phcontrol {words}", "COMP_CWORD": str(len(words.split()))}
    result = CliRunner().invoke(app, env={**line, "_PHCONTROL_COMPLETE": "complete_bash"}, prog_name="phcontrol")
    found = set(result.output.split())
    assert offered <= found if offered else not found
    assert all(name.startswith(words.split()[-1]) for name in found)
