"""Every example runs as it stands, does what it says, and leaves a page that can be opened."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path

import numpy as np
import pytest

from phcontrol import MechanicalSystem, RobotDescriptionError, certify, load_robot
from phcontrol.runs.certificate_survey import every_arm
from tests.browser import run_of

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.argv", [name])
    return runpy.run_path(str(EXAMPLES / name), run_name="__main__")


def test_position_control(tmp_path, monkeypatch):
    it = run("position_control.py", tmp_path, monkeypatch)
    assert it["certificate"].passed
    error = abs(it["log"].position - it["goal"]).max(axis=1)
    assert error[it["before"]][-1] < 1e-4
    assert 1e-4 < error[it["after"]].max() < 0.01  # the load is felt
    assert error[-1] < 1e-5  # and taken up


def test_grasp_egg(tmp_path, monkeypatch):
    it = run("grasp_egg.py", tmp_path, monkeypatch)
    assert it["log"].contact_force[-1] == pytest.approx(it["force"], rel=0.01)
    assert it["log"].contact_force.max() < 1.2 * it["force"]


def test_track_on_ur5(tmp_path, monkeypatch):
    it = run("track_on_ur5.py", tmp_path, monkeypatch)
    assert it["certificate"].passed
    assert 1e-4 < it["errors"].max() < 5e-3  # [rad]: what 20 % of friction costs
    assert it["errors"][-1] < 1e-5


def test_identify_payload(tmp_path, monkeypatch):
    it = run("identify_payload.py", tmp_path, monkeypatch)
    held, found, true = it["HELD"], it["found"], it["FRICTION"]
    assert found.passed
    assert found.payload.mass == pytest.approx(held.mass, rel=0.01)
    np.testing.assert_allclose(found.robot.friction.coulomb, true.coulomb, rtol=0.05)
    np.testing.assert_allclose(found.robot.friction.viscous, true.viscous, rtol=0.05)
    np.testing.assert_allclose(found.robot.model.armature, it["ROTORS"], rtol=0.1)
    assert it["errors"]["before"] > 5.0 * it["errors"]["after"]
    assert it["certificate"].passed
    assert it["mass"] == pytest.approx(it["other"].mass, rel=0.05)
    assert max(it["hand"]) <= 1e-3


def test_drag_goal(tmp_path, monkeypatch):
    it = run("drag_goal.py", tmp_path, monkeypatch)
    assert it["error"] < 1e-4
    assert it["goal"].has_arrived
    np.testing.assert_allclose(it["stiffness"](4.0), [1500.0, 600.0, 200.0])
    assert np.diff(it["log"].storage).max() < 1e-4


def test_own_controller(tmp_path, monkeypatch):
    it = run("own_controller.py", tmp_path, monkeypatch)
    assert it["certificate"].passed
    assert np.abs(it["log"].position[-1] - it["goal"]).max() < 1e-4
    assert (np.diff(it["log"].storage) <= 1e-9).all()
    (law,) = [node for node in ast.parse(EXAMPLES.joinpath("own_controller.py").read_text()).body
              if isinstance(node, ast.ClassDef)]  # fmt: skip
    statements = [line for method in law.body if isinstance(method, ast.FunctionDef) for line in method.body]
    assert len(statements) <= 8


CATALOGUE = [name for name in every_arm() if name not in ("tiago", "tiago_dual")]  # 48 and 101 joints take long
REFUSED = {"bravo7_gripper", "alex_psyonic_hands"}  # descriptions that are broken


@pytest.mark.parametrize("arm", CATALOGUE)
@pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")
def test_the_law_of_the_example_runs_on_every_arm(arm, monkeypatch):
    """Without friction and with it, with prismatic, continuous and mimic joints."""
    law = runpy.run_path(str(EXAMPLES / "own_controller.py"), run_name="own_controller")["BoundedSpring"]
    if arm in REFUSED:
        with pytest.raises(RobotDescriptionError):
            MechanicalSystem(load_robot(arm))
        return
    system = MechanicalSystem(load_robot(arm))
    made = law.tuned(system, system.robot.near_home())
    certificate = certify(made, samples=4)
    assert certificate.passed, str(certificate)
    assert certificate.matching_residual < 1e-7  # of states close to rest and on lines, too: differences have rounding
    x = system.at(system.robot.home)  # at rest the torque is what the docstring says
    expected = x.potential_gradient - made.stiffness * 0.2 * np.tanh((x.position - made.goal) / 0.2)
    torque = made.evaluate(0.0, x, np.zeros(0)).torque
    np.testing.assert_allclose(x.input_matrix @ torque, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())


def test_own_urdf(tmp_path, monkeypatch):
    it = run("own_urdf.py", tmp_path, monkeypatch)
    assert it["certificate"].passed
    assert np.abs(it["log"].position[-1] - it["goal"]).max() < 1e-3


def test_servo_to_object(tmp_path, monkeypatch):
    it = run("servo_to_object.py", tmp_path, monkeypatch)
    assert it["certificate"].passed
    assert it["error"][-1] < 2e-5  # [m] on the image plane: a pixel is 3.1e-5


def test_servo_and_grasp_is_one_closed_loop(tmp_path, monkeypatch):
    """The hand is at the block before it closes, and then holds it with the desired force."""
    it = run("servo_and_grasp.py", tmp_path, monkeypatch)
    assert all(certificate.passed for certificate in it["certificates"])
    log = it["log"]
    assert log.time[it["touch"]] > it["close_at"]
    assert it["distance"] < 1e-3  # [m]
    assert log.contact_force[-1] == pytest.approx(0.5, rel=0.02)
    assert log.contact_force.max() < 0.75
    after = log.time >= it["close_at"]
    moved = np.abs(log.position[after, :7] - log.position[after, :7][0]).max()
    assert moved < 0.02  # [rad]: the arm stays where it is while the hand closes
    assert (log.position >= it["robot"].lower).all()
    assert (log.position <= it["robot"].upper).all()
    page = run_of((tmp_path / "servo_and_grasp.html").read_text())
    for part in ("camera/frustum", "object/box", "bodies/0/left_finger", "goal/hand"):
        assert part in page


def test_every_example_is_tested_and_says_what_it_is():
    tests = "".join(path.read_text() for path in Path(__file__).parent.rglob("test_*.py"))
    for path in EXAMPLES.glob("*.py"):
        assert f'"{path.name}"' in tests, path.name
        assert path.read_text().startswith('"""')


def test_cartesian_impedance(tmp_path, monkeypatch):
    it = run("cartesian_impedance.py", tmp_path, monkeypatch)
    assert it["certificate"].passed
    np.testing.assert_allclose(it["moved"], it["expected"], atol=5e-6)
    assert it["turned"] > 0.2
    assert it["log"].tank_level.min() > 0.02
    assert (tmp_path / "cartesian_impedance.html").exists()


def test_variable_stiffness(tmp_path, monkeypatch):
    it = run("variable_stiffness.py", tmp_path, monkeypatch)
    assert it["certificate"].passed
    assert it["excess"]["unpaid"].max() > 1.0
    assert it["excess"]["cartesian_impedance"].max() < 1e-6
    assert it["level"].min() >= 0.02


def test_wipe_table(tmp_path, monkeypatch):
    it = run("wipe_table.py", tmp_path, monkeypatch)
    assert it["certificate"].verdict == "PASSED AS DRIVEN"
    assert it["off"] < 0.5
    assert it["way"] > 0.3
    assert it["drag"] == pytest.approx(0.4 * 10.0, rel=0.02)
    assert it["balance"].energy_drift < 1e-4


def test_which_gains(tmp_path, monkeypatch):
    it = run("which_gains.py", tmp_path, monkeypatch)
    assert it["designed"].met
    assert it["by_torque"].stable
    assert it["by_period"].linear.sampled(4e-3, 1).stable
    assert it["tuned"].value < it["tuned"].start_value
    assert 0.0 < it["used"] < 1.0
    assert "a start with a storage function" in it["loop"].reason
