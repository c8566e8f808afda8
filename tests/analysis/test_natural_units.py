"""What counts as large on an arm: limits where there are any, what weight and inertia ask for where there are none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from phcontrol import MechanicalSystem, make_controller
from phcontrol.analysis.natural_units import NaturalUnits
from tests.conftest import make_system


def units_of(law, system):
    made = make_controller(law, system)
    return made, NaturalUnits.of(made, system, 0.0)


def test_those_of_an_arm_are_its_limits():
    system = make_system("panda_with_fingers")
    _, units = units_of("energy_shaping", system)
    np.testing.assert_array_equal(units.position, np.where(system.robot.prismatic, 0.3, 1.0))
    np.testing.assert_array_equal(units.speed, system.robot.velocity_limit)
    np.testing.assert_array_equal(units.force, system.robot.effort_limit)
    assert units.state.shape == (0,)
    np.testing.assert_array_equal(units.motion, np.concatenate([units.position, units.speed]))


@pytest.mark.parametrize("limit", [np.inf, 1e4])
def test_without_limits_they_are_a_turn_a_second_and_what_weight_and_inertia_ask_for(limit):
    robot = make_system("panda_with_fingers").robot
    nothing = np.full(robot.n, np.inf)
    system = MechanicalSystem(dataclasses.replace(robot, velocity_limit=np.full(robot.n, limit), effort_limit=nothing))
    made, units = units_of("energy_shaping", system)
    np.testing.assert_allclose(units.speed, 2.0 * np.pi * np.where(robot.prismatic, 0.1, 1.0))
    own = np.diag(system.at(made.goal).mass_matrix) * units.speed  # to its speed in a second
    generator = np.random.default_rng(7)
    weights = [np.abs(system.at(robot.random_position(generator)).potential_gradient) for _ in range(200)]
    assert (units.force >= own * (1.0 - 1e-12)).all()
    assert (units.force - own <= 1.05 * np.max(weights, axis=0) + 1e-12).all()
    assert (units.force - own)[1] > 0.5 * np.max(weights, axis=0)[1]  # the shoulder carries the arm


@pytest.mark.parametrize("law", ["force_feedback", "integral_action"])
def test_a_state_of_one_unit_stores_as_much_as_the_arm_at_full_speed(law):
    system = make_system("panda")
    made, units = units_of(law, system)
    rest = system.at(made.goal)
    state = made.initial_state(rest)
    energy = 0.5 * float(np.diag(rest.mass_matrix) @ system.robot.velocity_limit**2)
    for entry, unit in zip(np.eye(made.state_size), units.state, strict=True):
        stored = made.storage(0.0, rest, state + unit * entry) - made.storage(0.0, rest, state)
        assert stored == pytest.approx(energy, rel=1e-9)
