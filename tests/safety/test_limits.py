"""Limits: the velocity bounds are those from which a joint can just stop, and braking stays within the effort."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import (
    InvalidArgumentError,
    Limits,
    MechanicalSystem,
    RobotDescriptionError,
    StopVelocity,
    UnknownNameError,
    load_robot,
)
from phcontrol.safety.franka_limits import FRANKA_LIMITS
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


# --- velocities near the stops --------------------------------------------------------------------------------


def libfrankas_highest(q):
    """``computeUpperLimitsJointVelocity`` of libfranka's rate_limiting.h, without its tolerance, as it stands there."""
    return np.array(
        [
            min(2.62, max(0.0, -0.30 + np.sqrt(max(0.0, 12.0 * (2.75010 - q[0]))))),
            min(2.62, max(0.0, -0.20 + np.sqrt(max(0.0, 5.17 * (1.79180 - q[1]))))),
            min(2.62, max(0.0, -0.20 + np.sqrt(max(0.0, 7.00 * (2.90650 - q[2]))))),
            min(2.62, max(0.0, -0.30 + np.sqrt(max(0.0, 8.00 * (-0.1458 - q[3]))))),
            min(5.26, max(0.0, -0.35 + np.sqrt(max(0.0, 34.0 * (2.81010 - q[4]))))),
            min(4.18, max(0.0, -0.35 + np.sqrt(max(0.0, 11.0 * (4.52050 - q[5]))))),
            min(5.26, max(0.0, -0.35 + np.sqrt(max(0.0, 34.0 * (3.01960 - q[6]))))),
        ]
    )


def libfrankas_lowest(q):
    return np.array(
        [
            max(-2.62, min(0.0, 0.30 - np.sqrt(max(0.0, 12.0 * (2.750100 + q[0]))))),
            max(-2.62, min(0.0, 0.20 - np.sqrt(max(0.0, 5.17 * (1.791800 + q[1]))))),
            max(-2.62, min(0.0, 0.20 - np.sqrt(max(0.0, 7.00 * (2.906500 + q[2]))))),
            max(-2.62, min(0.0, 0.30 - np.sqrt(max(0.0, 8.00 * (3.048100 + q[3]))))),
            max(-5.26, min(0.0, 0.35 - np.sqrt(max(0.0, 34.0 * (2.810100 + q[4]))))),
            max(-4.18, min(0.0, 0.35 - np.sqrt(max(0.0, 11.0 * (-0.54092 + q[5]))))),
            max(-5.26, min(0.0, 0.35 - np.sqrt(max(0.0, 34.0 * (3.019600 + q[6]))))),
        ]
    )


def test_franka_limits_near_the_stops_are_libfrankas():
    documented, rng = FRANKA_LIMITS["fr3"], np.random.default_rng(0)
    lower, upper, velocity = (np.array(field) for field in (documented.lower, documented.upper, documented.velocity))
    for _ in range(300):
        q = rng.uniform(lower - 0.05, upper + 0.05)
        high, low = documented.stop_velocity.upper(q, upper), documented.stop_velocity.lower(q, lower)
        np.testing.assert_allclose(np.minimum(high, velocity), libfrankas_highest(q), atol=1e-12)
        np.testing.assert_allclose(np.maximum(low, -velocity), libfrankas_lowest(q), atol=1e-12)


@pytest.mark.parametrize("braking", [2.0, 50.0])
def test_driven_at_the_bounds_an_arm_keeps_the_velocities_near_the_stops(braking):
    """From the middle to each stop as fast as allowed: under the robot's curve at every period, and near it.

    Without it (before) the arm was at 2.238 rad/s where 2.136 is allowed. Where braking is weaker than the curve's
    deceleration, no step asks for more than it.
    """
    system, stop = make_system("panda"), FRANKA_LIMITS["fr3"].stop_velocity
    limits = Limits(system, velocity=[2.62] * 4 + [5.26, 4.18, 5.26], stop_velocity=stop, braking_acceleration=braking)
    bare = Limits(system, velocity=[2.62] * 4 + [5.26, 4.18, 5.26], stop_velocity=None, braking_acceleration=braking)
    robot = system.robot
    for side, stops, allowed in ((1, robot.upper, stop.upper), (0, robot.lower, stop.lower)):
        worst = {}
        for name, kept in (("kept", limits), ("bare", bare)):
            q, v = 0.5 * (robot.lower + robot.upper), np.zeros(7)
            excess, nearest, hardest = -np.inf, np.inf, 0.0
            for _ in range(6000):
                following = kept.velocity_bounds(q, v, PERIOD)[side]
                hardest = max(hardest, (np.abs(v) - np.abs(following)).max() / PERIOD)
                q, v = q + 0.5 * PERIOD * (v + following), following
                beyond = np.abs(v) - np.abs(allowed(q, stops))
                excess, nearest = max(excess, beyond.max()), min(nearest, np.abs(beyond).max())
            worst[name] = excess
            if name == "kept":
                assert hardest <= braking * 1.01
                np.testing.assert_allclose(np.abs(stops - q), stop.no_speed, atol=2e-3)
        assert worst["kept"] <= 1e-9
        assert braking < 3.0 or worst["bare"] > 0.3


def test_the_velocity_margin_lowers_the_velocities_near_the_stops_too():
    system, stop = make_system("panda"), StopVelocity(0.3, 4.0)
    limits = Limits(system, stop_velocity=stop, velocity_margin=0.2, braking_acceleration=50.0, velocity=50.0)
    q = system.robot.upper - 0.3
    high = limits.velocity_bounds(q, np.zeros(7), 1e-6)[1]
    np.testing.assert_allclose(high, 0.8 * stop.upper(q, system.robot.upper), rtol=1e-5)


def test_frankas_limits_are_the_documented_ones_and_the_descriptions_where_narrower():
    system = make_system("panda")
    limits = Limits.franka(system, "fer", velocity_margin=0.0, position_margin=0.0)
    np.testing.assert_array_equal(limits.torque_rate, 999.999)  # at 1000 rounding decides whether a robot stops
    np.testing.assert_array_equal(limits.effort, [87.0] * 4 + [12.0] * 3)
    assert (limits.braking_acceleration <= [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]).all()
    assert (limits.velocity == np.minimum(FRANKA_LIMITS["fer"].velocity, system.robot.velocity_limit)).all()
    research = Limits.franka(system, velocity_margin=0.0, position_margin=0.0)
    np.testing.assert_array_equal(research.torque_rate, 999.999)
    assert (research.braking_acceleration <= 10.0).all()
    rng = np.random.default_rng(0)
    for _ in range(200):  # the first bound that binds may be the narrower one of the Panda's description
        q = rng.uniform(research.lower, research.upper)
        low, high = research.velocity_bounds(q, np.zeros(7), PERIOD)
        assert (high <= libfrankas_highest(q + PERIOD * high) + 1e-9).all()
        assert (low >= libfrankas_lowest(q + PERIOD * low) - 1e-9).all()
    with pytest.raises(InvalidArgumentError, match="system: must be an arm of 7 joints, but ur5 has 6"):
        Limits.franka(make_system("ur5"))
    with pytest.raises(UnknownNameError, match="model"):
        Limits.franka(system, "fr2")


def test_the_ranges_of_frankas_older_arm_are_those_of_its_description():
    """Franka's own URDF of the Panda, which was written from the same table."""
    robot, documented = make_system("panda").robot, FRANKA_LIMITS["fer"]
    np.testing.assert_array_equal(documented.lower, robot.lower)
    np.testing.assert_array_equal(documented.upper, robot.upper)
    np.testing.assert_array_equal(documented.velocity, robot.velocity_limit)
    np.testing.assert_array_equal(documented.effort, robot.effort_limit)


FRANKA_JOINT = """
<joint name="joint" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
  <limit effort="87.0" lower="-3.0770" upper="-0.1169" velocity="2.62"/>
  {near}
  <dynamics D="1" K="7000" damping="0.003" friction="0.2" gear_ratio="120.0" motor_inertia="3.2e-05"/>
</joint>"""
LINK = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def franka_joint(tmp_path, near):
    path = tmp_path / "arm.urdf"
    path.write_text(
        f'<robot name="arm"><link name="a"/><link name="b">{LINK}</link>{FRANKA_JOINT.format(near=near)}</robot>'
    )
    return load_robot(path)


def test_velocities_near_the_stops_are_read_from_a_urdf(tmp_path):
    near = '<position_based_velocity_limits deceleration_limit="4.0" velocity_offset="0.3542"/>'
    robot = franka_joint(tmp_path, near)
    assert robot.stop_velocity.offset == 0.3542
    assert robot.stop_velocity.deceleration == 4.0
    limits = Limits(MechanicalSystem(robot, friction=None), braking_acceleration=20.0)
    high = limits.velocity_bounds(np.array([-0.8]), np.zeros(1), 1e-6)[1]
    np.testing.assert_allclose(high, -0.3542 + np.sqrt(8.0 * (-0.1169 + 0.8)), rtol=1e-5)
    assert franka_joint(tmp_path, "").stop_velocity is None


@pytest.mark.parametrize(
    ("near", "message"),
    [
        ('<position_based_velocity_limits velocity_offset="0.3"/>', "has no deceleration_limit"),
        ('<position_based_velocity_limits deceleration_limit="4"/>', "has no velocity_offset"),
        (
            '<position_based_velocity_limits deceleration_limit="0" velocity_offset="0.3"/>',
            "deceleration_limit 0; it must be above zero",
        ),
        (
            '<position_based_velocity_limits deceleration_limit="4" velocity_offset="-0.3"/>',
            "velocity_offset -0.3; it must not be negative",
        ),
        (
            '<position_based_velocity_limits deceleration="4" velocity_offset="0.3"/>',
            "has no attribute 'deceleration'",
        ),
        ('<position_based_velocity_limit deceleration_limit="4"/>', "would be overlooked"),
    ],
)
def test_bad_velocities_near_the_stops_are_refused(tmp_path, near, message):
    with pytest.raises(RobotDescriptionError, match=message):
        franka_joint(tmp_path, near)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-0.1, 4.0), "offset: must be finite and >= 0"),
        ((0.1, 0.0), "deceleration: must be > 0"),
        ((0.1, np.nan), "deceleration: must be > 0"),
        (([0.1, 0.2], [1.0, 2.0, 3.0]), "offset: must be one number or one each joint"),
        (("x", 1.0), "offset: must be one number"),
    ],
)
def test_bad_stop_velocities_are_refused(arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        StopVelocity(*arguments)


def test_stop_velocities_of_another_arm_are_refused(pera):
    with pytest.raises(InvalidArgumentError, match="stop_velocity: must be for 7 joints, but is for 2"):
        Limits(pera, stop_velocity=StopVelocity([0.1, 0.2], 3.0))
    with pytest.raises(InvalidArgumentError, match="stop_velocity: must be 'robot', a StopVelocity or None"):
        Limits(pera, stop_velocity=3.0)
