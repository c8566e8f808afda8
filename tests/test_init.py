"""``phcontrol init``: a project whose test passes, and whose notebook and commands run, as they are written."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from phcontrol.cli import app
from tests.notebooks import execute

ROOT = Path(__file__).parents[1]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}


def init(*arguments):
    return CliRunner().invoke(app, ["init", *map(str, arguments)])


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project about an arm that is a file in another folder."""
    monkeypatch.chdir(tmp_path)
    Path("arms").mkdir()
    (description,) = re.findall(r"```xml\n(.*?)```", (ROOT / "docs" / "tutorial.md").read_text(), re.DOTALL)
    Path("arms", "little arm.urdf").write_text(description)
    result = init("my-robot", "--robot", Path("arms", "little arm.urdf"))
    assert result.exit_code == 0, result.output
    assert "next: cd my-robot && python -m pytest" in result.output
    return tmp_path / "my-robot"


def test_its_test_passes_and_fails_when_the_law_is_wrong(project):
    def tested():
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
        return subprocess.run(command, cwd=project, env=ENVIRONMENT, capture_output=True, text=True, check=False)

    first = tested()
    assert first.returncode == 0, first.stdout + first.stderr
    assert "2 passed" in first.stdout
    law = project / "law.py"
    law.write_text(law.read_text().replace("gradient=self.stiffness @ error", "gradient=2.0 * self.stiffness @ error"))
    wrong = tested()
    assert wrong.returncode == 1
    assert "test_the_closed_loop_is_what_the_law_promises" in wrong.stdout


@pytest.mark.study
def test_its_commands_and_its_notebook_run(project, monkeypatch):
    monkeypatch.chdir(project)
    (block,) = re.findall(r"```sh\n(.*?)```", (project / "README.md").read_text(), re.DOTALL)
    commands = [line.split("  #")[0] for line in block.splitlines() if line.startswith("phcontrol ")]
    assert [shlex.split(command)[1] for command in commands] == ["certify", "run", "sweep", "sweep-report"]
    for command in commands:
        quick = [] if "sweep" in command else ["--samples", "16"]
        arguments = [sys.executable, "-m", "phcontrol.cli", *shlex.split(command)[1:], *quick]
        result = subprocess.run(arguments, env=ENVIRONMENT, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout + result.stderr
        assert "sweep" in command or "law:MyLaw" in result.stdout or "my_law" in result.stdout
    assert "64 of 64 runs, 0 failed" in result.stdout
    assert "law:MyLaw" in (project / "results" / "sweep" / "report.html").read_text()
    assert (project / "run.html").stat().st_size > 250_000
    executed = execute(project / "first_run.ipynb", project)
    assert "PASSED" in executed


def test_its_sweep_is_of_the_law_and_the_arm_as_they_are_now(project):
    """The folder's own law is found; once it or the arm's file is another, its results are those of another sweep."""
    spec = project / "sweep.toml"
    spec.write_text(spec.read_text().replace("runs = 64", "runs = 3").replace("duration = 2.0", "duration = 0.02"))

    def swept(folder):
        arguments = [sys.executable, "-m", "phcontrol.cli", "sweep", "sweep.toml", "--out", folder, "--workers", "1"]
        return subprocess.run(arguments, cwd=project, env=ENVIRONMENT, capture_output=True, text=True, check=False)

    first = swept("here")
    assert first.returncode == 0, first.stdout + first.stderr
    assert "3 of 3 runs, 0 failed" in first.stdout
    assert "next, its page: phcontrol sweep-report here --spec sweep.toml" in first.stdout
    assert swept("here").returncode == 0
    for file, old, new in (
        (project / "law.py", "0.5 * error", "0.6 * error"),
        (project.parent / "arms" / "little arm.urdf", 'mass value="2"', 'mass value="2.1"'),
    ):
        text = file.read_text()
        assert old in text
        file.write_text(text.replace(old, new))
        changed = swept("here")
        file.write_text(text)
        assert changed.returncode == 2, changed.stdout + changed.stderr
        assert "here holds another sweep" in changed.stderr
    assert swept("here").returncode == 0


def test_what_it_writes_is_formatted_and_checked_as_the_package_is(project):
    for command in (["format", "--check"], ["check", "--select", "E,F,W,I,B"]):
        result = subprocess.run(
            [sys.executable, "-m", "ruff", *command, "--line-length", "120", "--isolated", "."],
            cwd=project,
            capture_output=True,
            text=True,
        )
        assert result.returncode == 0, result.stdout


def test_a_name_and_locked_joints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    assert init("empty", "--robot", "panda", "--lock", "panda_finger_joint1").exit_code == 0
    text = Path("empty", "arm.py").read_text()
    assert 'SOURCE = "panda"' in text
    assert '["panda_finger_joint1"]' in text
    assert "--robot panda --controller law:MyLaw --lock panda_finger_joint1" in Path("empty", "README.md").read_text()


@pytest.mark.parametrize("there", [True, False])
def test_a_missing_pytest_is_said(tmp_path, monkeypatch, there):
    """phcontrol does not bring pytest: a newcomer's ``pytest`` was not found, or was that of another environment."""
    monkeypatch.setattr("phcontrol.cli.init.find_spec", lambda name: object() if there else None)
    result = init(tmp_path / "mine", "--robot", "ur5")
    assert result.exit_code == 0, result.output
    assert ("pytest is missing: pip install pytest" in result.output) is not there
    page = (tmp_path / "mine" / "README.md").read_text()
    assert "\npython -m pytest " in page
    assert "pip install pytest" in page


def test_nothing_is_written_where_something_is_or_for_an_arm_that_is_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("full").mkdir()
    Path("full", "mine.txt").write_text("mine")
    Path("file").write_text("mine")
    for place in ("full", "file"):
        result = init(place)
        assert result.exit_code == 2
        assert f"must be a new or an empty folder, but {place} is there already" in result.output
    assert init("new", "--robot", "no_such_arm").exit_code == 2
    assert init(Path("deep", "under", "there"), "--robot", "ur5").exit_code == 0  # below the working directory
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep", "file", "full"]
    assert [path.name for path in Path("full").iterdir()] == ["mine.txt"]


def test_an_arm_that_needs_rotors_is_asked_for_them_and_its_project_has_them(tmp_path, monkeypatch):
    """Friction without rotors is too stiff: the project's own test used to diverge."""
    monkeypatch.chdir(tmp_path)
    refused = init("mine", "--robot", "xarm7")
    assert refused.exit_code == 2
    assert "--armature" in refused.output
    assert "must be given for xarm7, 0.05 for instance" in refused.output
    assert not Path("mine").exists()
    result = init("mine", "--robot", "xarm7", "--armature", "0.05")
    assert result.exit_code == 0, result.output
    arm = runpy.run_path("mine/arm.py")
    np.testing.assert_allclose(arm["make_system"]().robot.model.armature, 0.05)
    assert "--armature 0.05,0.05" in Path("mine", "README.md").read_text()
