"""What is said of a run, against runs that are made up."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from phcontrol import MechanicalSystem, load_robot
from phcontrol.runs.pick import FORCE, Pick
from phcontrol.runs.position import PositionRun, longest_stable_step
from phcontrol.runs.servo import ServoRun

HELD = Pick(1, (), "hold", "", 10, 10, FORCE, 0.001, ())


def test_an_object_is_held_in_the_last_phase_with_its_force_within_the_limits():
    assert HELD.held
    assert replace(HELD, force=1.019 * FORCE).held
    assert not replace(HELD, force=1.021 * FORCE).held
    assert not replace(HELD, force=0.979 * FORCE).held
    assert not replace(HELD, phase="grasp").held
    assert not replace(HELD, departures=("velocity of gripper",)).held
    assert HELD.in_view
    assert not replace(HELD, seen=9).in_view
    assert not replace(HELD, frames=0, seen=0).in_view


def test_the_error_and_the_overshoot_of_joints():
    robot = load_robot("pera_shoulder")
    positions = np.array([[0.0, 0.0], [0.5, 0.005], [1.1, 0.02], [0.98, 0.001]])
    run = PositionRun(SimpleNamespace(position=positions), None, np.array([1.0, 0.01]), 1.0, robot)
    np.testing.assert_allclose(run.errors, [1.0, 0.5, 0.1, 0.02])
    assert run.final_error == pytest.approx(0.02)
    assert run.outcome == "2.00e-02 rad (largest joint error)"
    assert run.overshoot == pytest.approx(0.1)  # the second joint's way is too short to count
    still = PositionRun(SimpleNamespace(position=np.ones((3, 2))), None, np.ones(2), 1.0, robot)
    assert still.overshoot == 0.0


def test_the_error_of_a_servo_is_a_features_in_millimetres():
    features = np.array([[1.0, 1.0, 1.0], [2e-6, -9.99e-6, 0.0]])
    run = ServoRun(SimpleNamespace(features=features), None, np.zeros(3), 1.0, None)
    assert run.final_error == 9.99e-6
    assert run.outcome == "9.99e-03 mm on the image plane (largest error of a feature)"


def test_where_nothing_is_damped_every_step_is_stable_and_no_joint_is_named():
    system = MechanicalSystem(load_robot("pera_shoulder"), friction=None)
    step, joint = longest_stable_step(SimpleNamespace(system=system), np.zeros(2))
    assert joint == ""
    assert step > 1e3
