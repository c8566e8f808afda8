"""Schedules: which law acts when, and what is handed over."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, make_controller, simulate
from phcontrol.controllers.schedule import Schedule
from tests.conftest import make_system


@pytest.fixture
def laws(shoulder):
    return [make_controller(name, shoulder, goal=[1.0, 0.5]) for name in ("force_feedback", "integral_action")]


def test_the_active_law_acts(shoulder, laws, rng):
    schedule = Schedule([(0.0, laws[0]), (1.0, laws[1])])
    x, state = shoulder.at([0.1, 0.2], [0.3, -0.4]), rng.normal(size=4)
    before, after = schedule.evaluate(0.999, x, state), schedule.evaluate(1.0, x, state)
    first, second = laws[0].evaluate(0.0, x, state[:2]), laws[1].evaluate(0.0, x, state)
    np.testing.assert_array_equal(before.torque, first.torque)
    np.testing.assert_array_equal(before.state_rate, np.r_[first.state_rate, 0.0, 0.0])  # the integral is held
    np.testing.assert_array_equal(after.torque, second.torque)
    np.testing.assert_array_equal(after.state_rate, second.state_rate)
    assert schedule.storage(0.5, x, state) == laws[0].storage(0.0, x, state[:2])
    assert schedule.target(1.5, x, state).coordinates.size == 8


def test_before_its_start_and_after_its_end_the_first_and_the_last_law_act(laws):
    schedule = Schedule([(0.0, laws[0]), (1.0, laws[1])])
    assert [schedule.active(t) for t in (-5.0, 0.0, 1.0 - 1e-9, 1.0, 99.0)] == [*[laws[0]] * 3, laws[1], laws[1]]


def test_it_rests_under_the_force_of_its_first_law(shoulder, laws):
    pressing = make_controller("force_control", shoulder, force=[2.0, -1.0])
    x = shoulder.at([0.1, 0.2])
    np.testing.assert_array_equal(Schedule([(0.0, pressing), (1.0, laws[0])]).rest_force(x), [2.0, -1.0])
    assert Schedule([(0.0, laws[0]), (1.0, pressing)]).rest_force(x) is None


def test_each_law_keeps_its_own_interconnection(rng):
    system = make_system("pera")  # on the arms of two and three joints both J̄₂ are the same matrix
    laws = [make_controller("integral_action", system, interconnection=form) for form in ("coriolis", "canonical")]
    schedule = Schedule([(0.0, laws[0]), (1.0, laws[1])])
    x, state = system.at(system.robot.random_position(rng), rng.normal(size=7)), rng.normal(size=14)
    torques = [law.evaluate(0.0, x, state).torque for law in laws]
    assert np.abs(torques[0] - torques[1]).max() > 1e-3  # the two laws differ away from the target
    for t, torque in zip((0.0, 1.0), torques, strict=True):
        np.testing.assert_array_equal(schedule.evaluate(t, x, state).torque, torque)


def test_shared_state_goes_on_and_new_state_starts_from_zero(shoulder, laws):
    schedule = Schedule([(0.0, laws[0]), (0.5, laws[1])])
    assert schedule.state_parts == {"force": 2, "integral": 2}
    log = simulate(shoulder, schedule, duration=1.0, disturbance=[3.0, -3.0])
    alone = simulate(shoulder, laws[0], duration=0.5, disturbance=[3.0, -3.0])
    np.testing.assert_allclose(log.controller_state[499, :2], alone.controller_state[499], atol=1e-12)
    assert (log.controller_state[:500, 2:] == 0.0).all()
    assert (log.controller_state[510, 2:] != 0.0).all()
    jump = np.abs(np.diff(log.controller_state[:, :2], axis=0)).max(axis=1)
    assert jump[499:502].max() < 2.0 * jump[480:499].max()  # z is continuous


def test_needs_are_those_of_all_laws(shoulder, laws):
    schedule = Schedule([(0.0, laws[0]), (1.0, make_controller("total_force_rejection", shoulder))])
    assert schedule.needs == ("total_force",)


def test_what_drives_any_of_the_laws_drives_it(shoulder, laws):
    pressing = make_controller("force_control", shoulder, feedforward=False)
    moved = Schedule([(0.0, laws[0]), (1.0, pressing), (2.0, laws[1])])
    assert moved.driven_by == pressing.driven_by != ""
    assert Schedule([(0.0, laws[0]), (1.0, laws[1])]).driven_by == ""


@pytest.mark.parametrize(
    ("starts", "complaint"), [([], "at least one pair"), ([1.0], "increase from 0"), ([0.0, 0.0], "increase from 0")]
)
def test_bad_times_are_refused(laws, starts, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        Schedule([(start, laws[0]) for start in starts])


def test_laws_of_different_systems_are_refused(laws):
    with pytest.raises(InvalidArgumentError, match="must be made with the same system"):
        Schedule([(0.0, laws[0]), (1.0, make_controller("energy_shaping", make_system("pera_gripper")))])
