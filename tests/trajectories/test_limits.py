"""The limit report against motions whose demands are known in closed form."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import MechanicalSystem, MinimumJerk, Sinusoid, check_limits, load_robot


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
