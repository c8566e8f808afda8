"""A law on any arm: the step that is chosen, and what is refused with which reason."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    EnergyShaping,
    InvalidArgumentError,
    MechanicalSystem,
    SimulationError,
    StribeckFriction,
    load_robot,
    make_controller,
)
from phcontrol.runs.position import run_position, stable_step


def gripper(viscous):
    """One joint of 0.5 kg m²."""
    return MechanicalSystem(load_robot("pera_gripper"), friction=StribeckFriction(viscous=viscous))


@pytest.mark.parametrize(
    ("viscous", "integrator", "expected"),
    [
        (1.0, "rk4", 1e-3),  # at ease
        (999.0, "rk4", 1e-3 / 2),  # (999 + 1)/0.5 = 2000 1/s: half of 2.78/2000 is 0.695 ms
        (1999.0, "rk4", 1e-3 / 3),
        (1999.0, "semi_implicit_euler", 1e-3 / 4),  # half of 2/4000
        (1e6, "implicit_midpoint", 1e-3),
    ],
)
def test_the_step_follows_the_friction(viscous, integrator, expected):
    system = gripper(viscous)
    law = EnergyShaping(system, goal=[0.5], stiffness=1.0, damping=1.0)
    assert stable_step(law, np.array([0.5]), integrator) == pytest.approx(expected)


def test_the_step_divides_the_control_period():
    law = EnergyShaping(gripper(1999.0), goal=[0.5], stiffness=1.0, damping=1.0)
    assert stable_step(law, np.array([0.5]), control_period=5e-3) == pytest.approx(5e-3 / 15)


def test_a_stiff_arm_runs_with_the_step_that_is_chosen_and_diverges_with_a_longer_one():
    system = gripper(1999.0)
    result = run_position(system, controller="energy_shaping", duration=0.1, samples=1)
    assert result.log.metadata["dt"] == pytest.approx(1e-3 / 3)
    assert np.abs(result.log.velocity).max() < 1.0
    with pytest.raises(SimulationError, match="the loop diverged.*longest stable step here is about 0.00067 s"):
        run_position(system, controller="energy_shaping", duration=0.1, samples=1, dt=1e-3)


def test_friction_without_rotors_is_refused_with_a_reason_and_runs_with_them():
    """The last joint of the xArm 7 has 1e-4 kg m² and a dry friction of 1 N·m."""
    system = MechanicalSystem(load_robot("xarm7"))
    complaint = "friction brakes joint 'joint7' of xarm7 so hard .*its description has friction but no rotor inertia"
    with pytest.raises(InvalidArgumentError, match=complaint):
        run_position(system, controller="tracking", duration=0.01)
    geared = MechanicalSystem(load_robot("xarm7", armature=0.05))
    result = run_position(geared, controller="tracking", duration=0.2, samples=2)
    assert result.errors.max() < 1e-9
    assert result.certificate.passed


def test_the_error_of_a_moving_goal_is_taken_at_each_sample(shoulder):
    result = run_position(shoulder, controller="tracking", goal=[0.4, 0.2], duration=3.0, dt=5e-3, samples=2)
    law = make_controller("tracking", shoulder, goal=[0.4, 0.2])
    expected = [
        np.abs(q - law.trajectory.at(t).position).max()
        for t, q in zip(result.log.time, result.log.position, strict=True)
    ]
    np.testing.assert_allclose(result.errors, expected, atol=1e-15)
    assert result.limits is not None
    assert result.limits.kept
    np.testing.assert_allclose(result.goal[-1], [0.4, 0.2], atol=1e-12)
