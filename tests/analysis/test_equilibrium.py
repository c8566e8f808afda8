"""Equilibria found numerically against closed forms and simulations."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, MechanicalSystem, PHControlError, make_controller, simulate
from phcontrol.analysis.equilibrium import equilibrium
from tests.conftest import make_system
from tests.simulation.idle import IdleLaw

FORCE = np.array([3.0, -3.0])
THESIS = {"goal": [1.0, 0.5], "stiffness": 15.0, "damping": 10.0}
SHIFTED = np.array([1.2, 0.3])


@pytest.mark.parametrize(
    ("law", "position"),
    [
        ("energy_shaping", SHIFTED),
        ("force_feedback", [1.0, 0.5]),
        ("force_feedback_measured", SHIFTED),
        ("integral_action", [1.0, 0.5]),
        ("total_force_rejection", [1.0, 0.5]),
    ],
)
def test_equilibria_of_the_shoulder_are_those_of_the_theory(shoulder, law, position):
    controller = make_controller(law, shoulder, **THESIS)
    rest = equilibrium(controller, shoulder, FORCE)
    np.testing.assert_allclose(rest.position, position, atol=1e-9)
    np.testing.assert_allclose(rest.target.rate(FORCE), 0.0, atol=1e-8)  # (2.45)


def test_integral_action_rests_with_the_force_in_its_integral(shoulder):
    rest = equilibrium(make_controller("integral_action", shoulder, **THESIS), shoulder, FORCE)
    np.testing.assert_allclose(rest.controller_state, np.r_[0.0, 0.0, FORCE], atol=1e-9)


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback", "force_feedback_measured"])
def test_the_shifted_storage_falls_to_zero_along_a_run(shoulder, law):
    """H_r is the Bregman form: positive, zero at the equilibrium, and here never growing."""
    controller = make_controller(law, shoulder, **THESIS)
    rest = equilibrium(controller, shoulder, FORCE)
    log = simulate(shoulder, controller, duration=25.0, dt=1e-2, disturbance=FORCE)
    shifted = rest.shifted_storage(log)
    assert shifted[0] > 1.0
    assert shifted[-1] == pytest.approx(0.0, abs=1e-8)
    assert shifted.min() >= -1e-12
    assert np.diff(shifted).max() <= 1e-10
    assert np.diff(log.storage).max() > 1e-4  # H_d itself does grow under the force


def test_a_seven_joint_arm_comes_to_rest_where_it_was_computed():
    system = make_system("pera")
    force = np.array([1.0, -2.0, 0.5, 0.5, -0.2, 0.1, 0.1])
    controller = make_controller("energy_shaping", system, goal=system.robot.home, stiffness=30.0)
    rest = equilibrium(controller, system, force)
    np.testing.assert_allclose(rest.position, system.robot.home + force / 30.0, atol=1e-9)


def test_a_wrong_model_shifts_the_equilibrium(shoulder):
    model = MechanicalSystem(shoulder.robot, gravity=[0.0, 0.0, -9.0])
    rest = equilibrium(make_controller("energy_shaping", model, **THESIS), shoulder, np.zeros(2))
    missing = shoulder.at(rest.position).gravity * (1.0 - 9.0 / 9.81)
    np.testing.assert_allclose(rest.position, np.array([1.0, 0.5]) - missing / 15.0, atol=1e-9)


def test_no_equilibrium_is_said_so(shoulder):
    """No torque at all, and a force that gravity (9.5 N·m at most) cannot hold."""
    with pytest.raises(PHControlError, match="found no equilibrium of idle"):
        equilibrium(IdleLaw(shoulder), shoulder, [50.0, 0.0])


def test_bad_input_is_refused(shoulder):
    with pytest.raises(InvalidArgumentError, match="external_force: must have shape"):
        equilibrium(make_controller("energy_shaping", shoulder, **THESIS), shoulder, [1.0])
