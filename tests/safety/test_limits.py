"""Limits: the velocity bounds are those from which a joint can just stop, and braking stays within the effort."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import InvalidArgumentError, Limits, MechanicalSystem, load_robot
from tests.conftest import make_system

PERIOD = 1e-3


def stopping_place(q, v, next_velocity, braking, period=PERIOD):
    """Where a joint stops that has next_velocity after one period: by the formula of uniform deceleration."""
    position = q + 0.5 * period * (v + next_velocity)
    return position + next_velocity * abs(next_velocity) / (2.0 * braking)


def test_at_the_bound_the_joint_stops_exactly_at_its_limit(pera):
    limits = Limits(pera, velocity=50.0, braking_acceleration=3.0)
    rng = np.random.default_rng(1)
    for _ in range(50):
        q = rng.uniform(limits.lower, limits.upper)
        v = rng.normal(size=7)
        low, high = limits.velocity_bounds(q, v, PERIOD)
        far = np.abs(limits.upper - q) > 0.01
        np.testing.assert_allclose(stopping_place(q, v, high, 3.0)[far], limits.upper[far], atol=1e-12)
        far = np.abs(limits.lower - q) > 0.01
        np.testing.assert_allclose(stopping_place(q, v, low, 3.0)[far], limits.lower[far], atol=1e-12)


@given(st.floats(0.0, 1.0), st.floats(0.2, 10.0), st.floats(1e-4, 2e-2))
def test_braking_keeps_the_bound_from_one_period_to_the_next(share, braking, period):
    """From a speed at the bound, v − αh is allowed again: the set is invariant, so no later conflict arises."""
    system = make_system("pera_gripper")
    limits = Limits(system, braking_acceleration=braking, velocity=1e3)
    q = limits.lower + share * (limits.upper - limits.lower) * 0.99
    v = np.zeros(1)
    for _ in range(3):
        high = limits.velocity_bounds(q, v, period)[1]
        q, v = q + 0.5 * period * (v + high), high
        slower = v - braking * period
        assert (limits.velocity_bounds(q, v, period)[1] >= slower - 1e-9).all()


def test_velocity_limits_bound_the_bounds_and_margins_shrink_them(pera):
    limits = Limits(pera, velocity_margin=0.1, position_margin=0.05)
    middle = 0.5 * (limits.lower + limits.upper)
    low, high = limits.velocity_bounds(middle, np.zeros(7), PERIOD)
    np.testing.assert_allclose(high, 0.9 * pera.robot.velocity_limit)
    np.testing.assert_allclose(low, -0.9 * pera.robot.velocity_limit)
    np.testing.assert_allclose(limits.upper, pera.robot.upper - 0.05)
    np.testing.assert_allclose(limits.lower, pera.robot.lower + 0.05)


def test_outside_its_limits_a_joint_is_asked_to_return_gently(pera):
    limits = Limits(pera)
    high = limits.velocity_bounds(limits.upper + 0.004, np.zeros(7), PERIOD)[1]
    np.testing.assert_allclose(high, -0.08)  # 0.004 rad in 0.05 s
    high = limits.velocity_bounds(limits.upper + 5.0, np.zeros(7), PERIOD)[1]
    np.testing.assert_allclose(high, -np.minimum(0.5, 0.25 * pera.robot.velocity_limit))
    low = limits.velocity_bounds(limits.lower - 0.004, np.zeros(7), PERIOD)[0]
    np.testing.assert_allclose(low, 0.08)


@pytest.mark.parametrize("arm", ["pera", "panda", "ur5", "kinova", "pera_shoulder"])
def test_all_joints_can_brake_at_once_within_their_effort(arm):
    """At new positions and velocities, all signs: M a + C q̇ + g stays within the effort (80 % at those sampled)."""
    system = make_system(arm)
    limits, rng, robot = Limits(system), np.random.default_rng(99), system.robot
    worst = 0.0
    for _ in range(300):
        x = system.at(robot.random_position(rng), rng.uniform(-1, 1, system.n) * robot.velocity_limit)
        a = limits.braking_acceleration * rng.choice([-1.0, 1.0], system.n)
        torque = x.mass_matrix @ a + x.coriolis_matrix @ x.velocity + x.potential_gradient
        worst = max(worst, np.max(np.abs(torque) / robot.effort_limit))
    assert 0.2 < worst < 1.0


@pytest.mark.parametrize("arm", ["pera", "panda", "ur5", "pera_shoulder"])
def test_all_accelerations_can_be_turned_at_once_within_the_torque_rate(arm):
    """At new positions and velocities, all signs, against the torque's difference along the motion (80 % is used)."""
    system = make_system(arm)
    limits, rng = Limits(system, torque_rate=2000.0), np.random.default_rng(98)
    worst, step, n = 0.0, 1e-5, system.n
    for _ in range(300):
        q = system.robot.random_position(rng)
        v = rng.uniform(-1, 1, n) * limits.velocity
        a = rng.uniform(-1, 1, n) * limits.braking_acceleration
        jerk = limits.braking_jerk * rng.choice([-1.0, 1.0], n)
        torques = []
        for t in (-step, step):
            x = system.at(q + t * v + 0.5 * t**2 * a, v + t * a)
            torques.append(x.mass_matrix @ (a + t * jerk) + x.coriolis_matrix @ x.velocity + x.potential_gradient)
        worst = max(worst, np.abs(torques[1] - torques[0]).max() / (2.0 * step) / 2000.0)
    assert 0.2 < worst < 1.0


def test_without_a_torque_rate_nothing_is_anticipated_and_single_joints_may_have_one(pera):
    assert np.isinf(Limits(pera).braking_jerk).all()
    rate = np.full(7, np.inf)
    rate[5] = 100.0
    limits = Limits(pera, torque_rate=rate)
    assert (np.isfinite(limits.braking_jerk) == np.isfinite(rate)).all()
    low, high = limits.velocity_bounds(0.5 * (limits.lower + limits.upper), np.zeros(7), PERIOD)
    free = np.arange(7) != 5
    np.testing.assert_array_equal(high[free], limits.velocity[free])
    assert 0.0 < high[5] < 0.2 * limits.velocity[5]
    assert low[5] == -high[5]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"effort": -1.0}, "effort: must be > 0"),
        ({"effort": "motor"}, "effort: must be 'robot' or numbers"),
        ({"effort": [1.0, 2.0]}, r"effort: must be a number or have shape \(7,\)"),
        ({"effort": 0.5}, "cannot hold the arm everywhere"),
        ({"velocity": np.nan}, "velocity: must be finite"),
        ({"velocity": "x"}, "velocity"),
        ({"lower": 1.0, "upper": 0.0}, "must be above lower"),
        ({"position_margin": 2.0}, "must be above lower"),
        ({"position_margin": -1.0}, "position_margin: must be >= 0"),
        ({"velocity_margin": 1.0}, "velocity_margin: must be <= 0.9"),
        ({"velocity_margin": -0.1}, "velocity_margin: must be >= 0"),
        ({"lower": 0.0, "upper": 0.0}, "must be above lower"),
        ({"torque_rate": 0.0}, "torque_rate: must be > 0"),
        ({"braking_acceleration": np.inf}, "braking_acceleration: must be finite"),
        ({"torque_rate": 1.0}, r"torque_rate: .* too little to follow the load at full speed: joint '\w+' needs more"),
        ({"braking_jerk": 0.0}, "braking_jerk: must be > 0"),
        ({"upper": object()}, "upper: must be"),
    ],
)
def test_bad_limits_are_refused(pera, arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        Limits(pera, **arguments)


def test_limits_do_not_change_with_the_arrays_they_were_made_of(pera):
    effort = np.full(7, 50.0)
    limits = Limits(pera, effort=effort)
    effort[:] = 0.0
    assert (limits.effort == 50.0).all()
    with pytest.raises(ValueError, match="read-only"):
        limits.effort[0] = 1.0


def test_the_gripper_spring_counts_as_a_load():
    robot = load_robot("pera_gripper")
    with_spring, without = Limits(MechanicalSystem(robot)), Limits(MechanicalSystem(robot), effort=100.0)
    assert with_spring.braking_acceleration < without.braking_acceleration
