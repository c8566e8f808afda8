"""ω and ω̇ of exp(φ×) beside power series that hold for every angle, and the order in which goals are taken up."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import InvalidArgumentError
from phcontrol.setpoints import LiveFramePath, LiveTrajectory, LiveValue, Setpoint
from phcontrol.setpoints.live_frame_path import _turning
from tests.conftest import make_system
from tests.finite_differences import derivative

ANGLES = [0.0, 1e-6, 1e-3, 5e-3, 0.0099999, 0.0100001, 0.02, 0.5, 2.0, 3.1]


def by_series(phi, rate, bend):
    """ω = Σ (Φ^k/(k + 1)!) φ̇ with Φ = φ×, and ω̇ by the product rule, term by term."""
    turn, turn_rate = pin.skew(phi), pin.skew(rate)
    power, power_rate = np.eye(3), np.zeros((3, 3))
    spin, spin_rate = np.zeros(3), np.zeros(3)
    for k in range(60):
        spin += power @ rate / math.factorial(k + 1)
        spin_rate += (power @ bend + power_rate @ rate) / math.factorial(k + 1)
        power, power_rate = power @ turn, power_rate @ turn + power @ turn_rate
    return spin, spin_rate


@pytest.mark.parametrize("angle", ANGLES)
def test_the_turning_of_a_rotation_vector_is_its_series(angle, rng):
    """Below 0.01 rad what its own short series leave out is below 1e-10 of rates of some rad/s, and of their rates."""
    for _ in range(5):
        axis = rng.normal(size=3)
        phi, rate, bend = angle * axis / np.linalg.norm(axis), rng.normal(size=3), rng.normal(size=3)
        spin, spin_rate = _turning(phi, rate, bend)
        expected, expected_rate = by_series(phi, rate, bend)
        np.testing.assert_allclose(spin, expected, atol=1e-13 if angle < 0.01 else 1e-11)
        np.testing.assert_allclose(spin_rate, expected_rate, atol=1e-10)


@pytest.mark.parametrize("angle", [1e-3, 0.0099999])
def test_each_term_of_the_short_series_counts(angle):
    """Each along the one direction in which it alone acts, at a rate so high that it is seen."""
    first, second, third = np.eye(3)
    phi, rate = angle * first, 1e4 * (first + second)
    spin, spin_rate = _turning(phi, rate, np.zeros(3))
    expected, expected_rate = by_series(phi, rate, np.zeros(3))
    # along the third axis a and its slope act, along the second b and its slope; left out are θ⁴/720 of a, θ²/180 of
    # its slope, θ⁴/5040 of b and 4θ²/5040 of its slope
    size = 1e4 * angle
    np.testing.assert_allclose(spin @ third, expected @ third, atol=2e-3 * size * angle**4 + 1e-12)
    np.testing.assert_allclose(spin @ second, expected @ second, atol=3e-4 * size * angle**5 + 4e-12)
    np.testing.assert_allclose(spin_rate @ third, expected_rate @ third, atol=7e-3 * size**2 * angle**2 + 1e-9)
    np.testing.assert_allclose(spin_rate @ second, expected_rate @ second, atol=1e-2 * size**2 * angle**3 + 1e-9)


def test_the_turning_is_the_derivative_of_the_rotation(rng):
    """By differences of exp(φ(t)×) alone, φ a parabola in time."""
    phi, rate, bend = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)

    def rotation(t):
        return pin.exp3(phi + t * rate + 0.5 * t**2 * bend)

    def spin_at(t):
        turned = derivative(lambda h: rotation(t + h)) @ rotation(t).T
        return np.array([turned[2, 1], turned[0, 2], turned[1, 0]])

    spin, spin_rate = _turning(phi, rate, bend)
    np.testing.assert_allclose(spin, spin_at(0.0), atol=1e-9)
    np.testing.assert_allclose(spin_rate, derivative(spin_at), atol=1e-7)


def test_a_path_turns_on_from_where_it_was():
    """Three turns, each from the orientation at which the one before was left."""
    path = LiveFramePath("tool", (np.zeros(3), np.eye(3)), turning_speed=1.0)
    about = [np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])]
    rotation = np.eye(3)
    for k, axis in enumerate(about):
        rotation = pin.exp3(0.7 * axis) @ rotation
        path.request((0.1 * axis, rotation))
        path.advance(100.0 * k)
        np.testing.assert_allclose(path.at(100.0 * k + 99.0).rotation, rotation, atol=1e-12)
        halfway = path.at(0.5 * (100.0 * k + path.duration)).rotation
        np.testing.assert_allclose(halfway, pin.exp3(-0.35 * axis) @ rotation, atol=1e-9)
    before = LiveFramePath("tool", (np.ones(3), pin.exp3(about[0]))).at(3.0)  # of which nothing was asked
    np.testing.assert_allclose(before.rotation, pin.exp3(about[0]), atol=1e-15)
    np.testing.assert_array_equal(before.position, np.ones(3))
    np.testing.assert_array_equal([*before.twist, *before.acceleration], np.zeros(12))


def test_changes_for_later_are_taken_up_at_their_times_in_their_order():
    value = LiveValue(0.0, rate=1e3)
    setpoint = Setpoint(value=value)
    setpoint.change(value=3.0, at=3.0)
    setpoint.change(value=1.0, at=1.0)
    setpoint.change(value=2.0, at=1.0)  # at the same time the later word counts
    asked = []
    for t in (0.0, 0.999, 1.0, 2.999, 3.0, 4.0):
        setpoint.advance(t)
        asked.append(float(value.goal))
        assert setpoint.time == t
    assert asked == [0.0, 0.0, 2.0, 2.0, 3.0, 3.0]
    assert float(value(10.0)) == 3.0
    setpoint.advance(10.0)
    assert value.has_arrived


def test_it_has_arrived_when_it_stands_and_nothing_waits():
    value = LiveValue(0.0, rate=1.0)
    assert not value.has_arrived  # before it was looked at
    value.advance(0.0)
    assert value.has_arrived
    value.request(1.0)
    assert not value.has_arrived
    value.advance(1.0)
    assert not value.has_arrived
    assert value.duration == pytest.approx(1.0 + 1.875)  # the peak of minimum jerk is 15/8 of the mean speed
    value.advance(value.duration)
    assert value.has_arrived


def test_goals_may_be_as_far_as_the_limits():
    """On each limit and anywhere between; beyond by a hair is refused, naming the joint that is the furthest out."""
    robot = make_system("pera_shoulder").robot
    goal = LiveTrajectory(robot)
    for posture in (robot.upper, robot.lower, 0.5 * (robot.lower + robot.upper), robot.upper - 0.01):
        goal.request(posture)
        np.testing.assert_array_equal(goal.goal, posture)
    beyond = robot.upper + np.array([1e-9, 2e-9])
    with pytest.raises(InvalidArgumentError, match=f"puts joint '{robot.joint_names[1]}' 2e-09 beyond its limit"):
        goal.request(beyond)
    np.testing.assert_array_equal(goal.goal, robot.upper - 0.01)
