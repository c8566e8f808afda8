"""The limit report against motions whose demands are known in closed form."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import InvalidArgumentError, MechanicalSystem, MinimumJerk, Sinusoid, check_limits, load_robot
from phcontrol.trajectories.minimum_jerk import usual_speed
from phcontrol.trajectories.trajectory import Reference


def test_peaks_of_a_sinusoid_are_found_where_they_are(shoulder):
    """Velocity A·2πf at the middle of the swing, position B + A at its end, limits 2 rad/s and 1.57 rad."""
    report = check_limits(Sinusoid([1.0, 0.2], 0.5, phase=0.0, offset=[0.7, 0.0]), shoulder, samples=2001)
    peaks = {(peak.quantity, peak.joint): peak for peak in report.peaks}
    position = peaks["position", "shoulder_pitch"]
    assert position.value == pytest.approx(1.7)
    assert position.limit == 1.57
    assert position.time == pytest.approx(0.5)
    begin = np.arcsin(0.87) / np.pi
    assert position.broken == (pytest.approx((begin, 1.0 - begin), abs=1e-3),)
    assert abs(peaks["velocity", "shoulder_pitch"].value) == pytest.approx(np.pi)
    assert len(peaks["velocity", "shoulder_pitch"].broken) == 3  # at the start, in the middle, at the end
    assert not peaks["velocity", "shoulder_roll"].broken
    assert not report.kept
    assert "limits: BROKEN" in str(report)
    assert "position of shoulder_pitch: 1.7 rad at 0.5 s, limit 1.57" in str(report)


def test_the_torque_is_that_of_inverse_dynamics(pera):
    """Against Pinocchio's recursive Newton-Euler algorithm with friction added."""
    goal = np.array([-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2])
    motion = MinimumJerk(pera.robot.home, goal, 3.0)
    data = pera.model.createData()
    torque = np.array(
        [
            pin.rnea(pera.model, data, *(row := motion.at(t))) + pera.friction.coefficients(row.velocity) * row.velocity
            for t in np.linspace(0.0, 3.0, 301)
        ]
    )
    peaks = [peak for peak in check_limits(motion, pera, samples=301).peaks if peak.quantity == "torque"]
    np.testing.assert_allclose(np.abs([peak.value for peak in peaks]), np.abs(torque).max(axis=0), rtol=1e-12)


def test_motions_within_the_velocity_limits_are_reported_kept(pera):
    motion = MinimumJerk.within_limits(pera.robot, pera.robot.home, [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2])
    report = check_limits(motion, pera)
    assert report.kept, str(report)
    assert len(report.peaks) == 21
    assert str(report) == "limits: position, velocity and torque kept"


def test_a_motor_through_gears_is_judged_by_its_own_torque():
    robot = load_robot("pera_gripper")
    still = MinimumJerk([0.6], [0.6], 1.0)
    plain, geared = (check_limits(still, MechanicalSystem(robot, input_matrix=G)) for G in (1.0, 0.01))
    torque = {name: report.peaks[-1] for name, report in (("plain", plain), ("geared", geared))}
    assert torque["geared"].value == pytest.approx(100.0 * torque["plain"].value)


class Still:
    """Stands at a position with a velocity that it does not move by: each limit can be met by itself."""

    n, duration = 2, 1.0

    def __init__(self, position=(0.0, 0.0), velocity=(0.0, 0.0)):
        self.reference = Reference(np.array(position), np.array(velocity), np.zeros(2))

    def at(self, t):
        return self.reference


def broken(motion, system):
    return [(peak.quantity, peak.joint, peak.limit) for peak in check_limits(motion, system, samples=2).violations]


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("side", ["lower", "upper"])
def test_on_a_limit_is_kept_and_beyond_it_is_not(shoulder, joint, side):
    """Beyond is more than rounding: 1e-9 of the limit, or of 1."""
    robot, unit = shoulder.robot, np.eye(2)[joint]
    sign, limit = (-1.0, robot.lower[joint]) if side == "lower" else (1.0, robot.upper[joint])
    scale = max(1.0, abs(limit))
    assert not broken(Still(limit * unit), shoulder)
    assert not broken(Still((limit + 0.9e-9 * sign * scale) * unit), shoulder)
    expected = [("position", robot.joint_names[joint], limit)]
    assert broken(Still((limit + 1.2e-9 * sign * scale) * unit), shoulder) == expected
    speed = sign * robot.velocity_limit[joint]
    assert not broken(Still(velocity=speed * unit), shoulder)
    assert broken(Still(velocity=speed * (1.0 + 1e-8) * unit), shoulder) == [
        ("velocity", robot.joint_names[joint], speed)
    ]


def test_the_limit_that_a_joint_comes_nearest_to(shoulder):
    for position, limit in [(-0.5, -1.57), (0.5, 1.57), (-1.7, -1.57), (1.7, 1.57)]:
        peak = check_limits(Still([position, 0.0]), shoulder, samples=2).peaks[0]
        assert (peak.value, peak.limit) == (position, limit)


def test_rounding_is_that_of_one_where_a_limit_is_less():
    near = MechanicalSystem(replace(load_robot("pera_shoulder"), upper=np.array([0.3, 0.0])))
    assert not broken(Still([0.3 + 0.9e-9, 0.9e-9]), near)
    assert broken(Still([0.3 + 1.1e-9, 1.1e-9]), near) == [
        ("position", near.robot.joint_names[0], 0.3),
        ("position", near.robot.joint_names[1], 0.0),
    ]


def test_each_run_beyond_a_limit_is_given_from_its_first_to_its_last_sample(shoulder):
    """A triangle wave between −1.7 and 1.7 rad, sampled so that the samples beyond ±1.57 are known."""

    class Triangle(Still):
        duration = 4.0

        def at(self, t):
            height = 1.7 * (1.0 - abs((t % 4.0) - 2.0))  # from −1.7 up to 1.7 at 2 s, and back
            return Reference(np.array([height, 0.0]), np.zeros(2), np.zeros(2))

    assert (shoulder.robot.lower[0], shoulder.robot.upper[0]) == (-1.57, 1.57)
    report = check_limits(Triangle(), shoulder, samples=401)
    (peak,) = report.violations
    # beyond where |t - 2| is less than 0.0765 or more than 1.9235
    expected = ((0.0, 0.07), (1.93, 2.07), (3.93, 4.0))
    np.testing.assert_allclose(peak.broken, expected, atol=1e-12)
    assert str(report).endswith("; broken 0 to 0.07 s, 1.93 to 2.07 s, 3.93 to 4 s")
    (peak,) = check_limits(Triangle(), shoulder, duration=1.9, samples=191).violations
    np.testing.assert_allclose(peak.broken, expected[:1], atol=1e-12)
    assert (peak.value, peak.limit, peak.time) == (-1.7, -1.57, 0.0)


def test_joints_without_a_limit_are_not_reported_and_with_one_are():
    system = MechanicalSystem(load_robot("kinova"))
    robot, still = system.robot, MinimumJerk(load_robot("kinova").home, load_robot("kinova").home, 1.0)
    reported = {(peak.quantity, peak.joint) for peak in check_limits(still, system, samples=2).peaks}
    bounds = {
        "position": (robot.lower, robot.upper),
        "velocity": (-robot.velocity_limit, robot.velocity_limit),
        "torque": (-robot.effort_limit, robot.effort_limit),
    }
    expected = {
        (quantity, name)
        for quantity, (low, high) in bounds.items()
        for name, a, b in zip(robot.joint_names, low, high, strict=True)
        if np.isfinite(a) or np.isfinite(b)
    }
    assert reported == expected
    assert not np.isfinite(robot.lower).all()


def test_by_default_it_looks_a_thousand_times(shoulder):
    """At steps of a thousandth of the duration: where a swing turns round after a quarter, a sample is."""
    peaks = check_limits(Sinusoid([1.0, 1.0], 0.5, phase=0.0), shoulder).peaks
    assert [peak.time for peak in peaks[:2]] == pytest.approx([0.5, 0.5], abs=1e-12)


def test_it_takes_two_samples_at_least_and_a_duration(shoulder):
    with pytest.raises(InvalidArgumentError, match="samples: must be an integer >= 2"):
        check_limits(Still(), shoulder, samples=1)
    with pytest.raises(InvalidArgumentError, match="duration: must be > 0"):
        check_limits(Still(), shoulder, duration=0.0)


def test_the_usual_speed_is_the_limit_or_what_a_joint_of_its_kind_does():
    limits = np.array([2.0, np.inf, np.inf])
    robot = SimpleNamespace(velocity_limit=limits, prismatic=(False, False, True), n=3)
    np.testing.assert_array_equal(usual_speed(robot), [2.0, 1.0, 0.1])
    robot = SimpleNamespace(velocity_limit=limits, prismatic=(), n=3)
    np.testing.assert_array_equal(usual_speed(robot), [2.0, 1.0, 1.0])
    home = load_robot("pera").home
    assert MinimumJerk.within_limits(load_robot("pera"), home, home + 1e-3).duration == 1.0  # [s], at least
