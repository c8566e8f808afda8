"""Trajectories: derivatives against finite differences, ends, interpolation, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import make_smoothing_spline

from phcontrol import (
    CubicSpline,
    InvalidArgumentError,
    MinimumJerk,
    QuinticSpline,
    SampledTrajectory,
    Sinusoid,
    load_robot,
)
from phcontrol._differences import central_difference
from phcontrol.trajectories.trajectory import Reference, Trajectory, check_trajectory

PERA = load_robot("pera")
TIMES = [0.5, 1.0, 1.8, 2.0, 3.1, 4.0, 4.5]
WAYPOINTS = np.array([[0.0, 0.3], [0.5, 0.1], [-0.2, 0.4], [0.1, 0.8], [1.0, -1.0], [0.4, 0.0], [0.0, 0.3]])
FINE = np.linspace(0.0, 6.0, 61)
MOTION = np.column_stack([np.sin(FINE), np.cos(2.0 * FINE) + FINE])
TRAJECTORIES = {
    "sinusoid": Sinusoid([0.7, 0.2], [0.3, 0.5], phase=[0.1, -1.0], offset=0.4),
    "minimum_jerk": MinimumJerk([0.0, 1.0], [1.0, -0.5], 2.5, start=0.5),
    "cubic": CubicSpline(TIMES, WAYPOINTS),
    "cubic_periodic": CubicSpline(TIMES, WAYPOINTS, periodic=True),
    "quintic": QuinticSpline(TIMES, WAYPOINTS),
    "quintic_periodic": QuinticSpline(TIMES, WAYPOINTS, periodic=True),
    "samples": SampledTrajectory(FINE, MOTION),
    "smoothed": SampledTrajectory(FINE, MOTION, smoothing=1e-6),
    "four_samples": SampledTrajectory(FINE[:4], MOTION[:4]),
    "two_samples": SampledTrajectory(FINE[:2], MOTION[:2]),
}


@pytest.mark.parametrize("name", list(TRAJECTORIES))
@given(t=st.floats(-3.0, 12.0))
def test_velocity_and_acceleration_are_the_derivatives(name, t):
    trajectory, step = TRAJECTORIES[name], 1e-3
    breaks = [*TIMES, *FINE, 3.0]
    shift = trajectory.duration if name.endswith("periodic") else 0.0
    near = [b + k * shift for b in breaks for k in (-1, 0, 1, 2, 3)]
    if min(abs(t - b) for b in near) < 2.5 * step:  # the third derivative may jump there
        t += 6.0 * step
    actual = trajectory.at(t)
    velocity = central_difference(lambda h: trajectory.at(t + h).position, step)
    acceleration = central_difference(lambda h: trajectory.at(t + h).velocity, step)
    np.testing.assert_allclose(actual.velocity, velocity, atol=1e-8)
    np.testing.assert_allclose(actual.acceleration, acceleration, atol=2e-7)


@pytest.mark.parametrize("name", list(TRAJECTORIES))
def test_everything_is_a_trajectory(name):
    assert isinstance(TRAJECTORIES[name], Trajectory)
    assert check_trajectory("trajectory", TRAJECTORIES[name], 2) is TRAJECTORIES[name]


def test_the_thesis_sinusoid():
    """(6.16) with A = B = 2π/9, φ = −π/2 at 1/30 Hz: from 0 at rest, to 4π/9 after half a period."""
    q1 = Sinusoid([2 * math.pi / 9, 0.0], 1 / 30, offset=[2 * math.pi / 9, 0.0])
    assert q1.duration == pytest.approx(30.0)
    np.testing.assert_allclose(q1.at(0.0).position, 0.0, atol=1e-15)
    np.testing.assert_allclose(q1.at(0.0).velocity, 0.0, atol=1e-15)
    np.testing.assert_allclose(q1.at(15.0).position, [4 * math.pi / 9, 0.0], atol=1e-15)
    assert q1.at(7.5).velocity[0] == pytest.approx(2 * math.pi / 9 * 2 * math.pi / 30)
    np.testing.assert_allclose(Sinusoid(0.5, 2.0).at(0.25).position, 0.5, atol=1e-15)  # about 0, if no offset is given


def test_minimum_jerk_is_the_optimum_and_its_peak_speed_is_known():
    """Any other motion with the same ends has more ∫|jerk|² dt; the known optimum is 720 (b−a)²/T⁵."""
    motion = MinimumJerk([0.0], [2.0], 3.0)
    times = np.linspace(0.0, 3.0, 3001)
    speeds = np.array([motion.at(t).velocity[0] for t in times])
    assert speeds.max() == pytest.approx(1.875 * 2.0 / 3.0, rel=1e-9)
    jerk = np.gradient([motion.at(t).acceleration[0] for t in times], times, edge_order=2)
    assert np.trapezoid(jerk**2, times) == pytest.approx(720.0 * 4.0 / 3.0**5, rel=1e-4)


def test_minimum_jerk_keeps_to_the_speed_and_takes_the_shorter_way():
    kinova = load_robot("kinova")
    goal = kinova.home.copy()
    goal[0] += 2.0 * np.pi - 0.5  # the first joint is continuous
    motion = MinimumJerk.within_limits(kinova, kinova.home, goal, fraction=0.2)
    assert motion.at(1e3).position[0] == pytest.approx(kinova.home[0] - 0.5)
    times = np.linspace(0.0, motion.duration, 501)
    speed = np.array([np.abs(motion.at(t).velocity) / kinova.velocity_limit for t in times])
    assert speed.max() == pytest.approx(0.2, rel=1e-3)


@pytest.mark.parametrize("name", ["minimum_jerk", "cubic", "quintic"])
def test_at_rest_before_and_after(name):
    trajectory = TRAJECTORIES[name]
    for t, position in ((-1.0, trajectory.at(0.5).position), (99.0, trajectory.at(trajectory.duration).position)):
        reference = trajectory.at(t)
        np.testing.assert_array_equal(reference.position, position)
        assert not reference.velocity.any()
        assert not reference.acceleration.any()
    inside = trajectory.at(trajectory.duration - 1e-9)
    np.testing.assert_allclose(inside.velocity, 0.0, atol=1e-7)
    if name != "cubic":
        np.testing.assert_allclose(inside.acceleration, 0.0, atol=1e-6)


@pytest.mark.parametrize("name", ["cubic", "cubic_periodic", "quintic", "quintic_periodic"])
def test_splines_pass_their_waypoints(name):
    for time, point in zip(TIMES, WAYPOINTS, strict=True):
        np.testing.assert_allclose(TRAJECTORIES[name].at(time).position, point, atol=1e-12)


@pytest.mark.parametrize("name", ["cubic_periodic", "quintic_periodic"])
def test_periodic_splines_repeat_smoothly(name):
    trajectory = TRAJECTORIES[name]
    for t in (0.5, 1.3, 4.49):
        for shift in (-2, 1, 5):
            for here, there in zip(trajectory.at(t), trajectory.at(t + shift * trajectory.duration), strict=True):
                np.testing.assert_allclose(here, there, atol=1e-9)
    before, after = trajectory.at(4.5 - 1e-9), trajectory.at(4.5 + 1e-9)
    np.testing.assert_allclose(before.velocity, after.velocity, atol=1e-6)
    np.testing.assert_allclose(before.acceleration, after.acceleration, atol=1e-5)


def test_samples_are_passed_and_the_motion_between_is_found():
    trajectory = TRAJECTORIES["samples"]
    for t in np.linspace(0.3, 5.7, 50):
        reference = trajectory.at(t)
        np.testing.assert_allclose(reference.position, [np.sin(t), np.cos(2 * t) + t], atol=1e-5)
        np.testing.assert_allclose(reference.velocity, [np.cos(t), 1 - 2 * np.sin(2 * t)], atol=1e-3)


def test_smoothing_is_the_smoothing_spline_and_takes_noise_away(rng):
    noisy = MOTION + 0.01 * rng.normal(size=MOTION.shape)
    trajectory = SampledTrajectory(FINE, noisy, smoothing=1e-3)
    references = [make_smoothing_spline(FINE, joint, lam=1e-3) for joint in noisy.T]
    rough = SampledTrajectory(FINE, noisy)
    for t in np.linspace(0.1, 5.9, 20):
        np.testing.assert_allclose(trajectory.at(t).position, [joint(t) for joint in references], atol=1e-12)
    alone = SampledTrajectory(FINE, noisy[:, :1], smoothing=1e-3)
    np.testing.assert_allclose(alone.at(1.7).position, [references[0](1.7)], atol=1e-12)
    errors = {
        name: np.abs(
            [path.at(t).velocity - [np.cos(t), 1 - 2 * np.sin(2 * t)] for t in np.linspace(0.5, 5.5, 99)]
        ).max()
        for name, path in (("smooth", trajectory), ("rough", rough))
    }
    assert errors["smooth"] < 0.5 * errors["rough"]


@pytest.mark.parametrize("kind", [CubicSpline, QuinticSpline, SampledTrajectory, MinimumJerk])
def test_two_points_of_one_joint_are_a_motion(kind):
    motion = kind([0.25], [0.5], 2.0) if kind is MinimumJerk else kind([0.0, 2.0], [[0.25], [0.5]])
    assert (motion.n, motion.duration) == (1, 2.0)
    np.testing.assert_allclose(motion.at(1.0).position, [0.375], atol=1e-12)  # half way, by symmetry
    assert Sinusoid(1.0, 0.5).n == 1


@pytest.mark.parametrize(("kind", "order"), [(CubicSpline, 4), (QuinticSpline, 6)])
def test_periodic_splines_are_as_good_as_their_degree_allows(kind, order):
    """Halving the distance of waypoints on a sine divides the error by 2^(degree + 1)."""
    errors = []
    for points in (17, 33):
        times = np.linspace(0.0, 2.0 * np.pi, points)
        waypoints = np.sin(times)[:, None]
        waypoints[-1] = waypoints[0]
        motion = kind(times, waypoints, periodic=True)
        errors.append(max(abs(motion.at(t).position[0] - np.sin(t)) for t in np.linspace(0.0, 6.0, 301)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)


@pytest.mark.parametrize(("kind", "least"), [(CubicSpline, 3), (QuinticSpline, 6)])
def test_the_fewest_points_of_a_period(kind, least):
    points = np.sin(2.0 * np.pi * np.arange(least) / (least - 1))[:, None]
    points[-1] = points[0]
    motion = kind(np.arange(least), points, periodic=True)
    np.testing.assert_allclose(motion.at(1.0).position, points[1], atol=1e-12)
    with pytest.raises(InvalidArgumentError, match=f"at least {least} points, but holds {least - 1}"):
        kind(np.arange(least - 1), np.zeros((least - 1, 1)), periodic=True)


class Own:
    """A trajectory of the user's, which gives what it is told to."""

    n, duration = 2, 1.0

    def __init__(self, given):
        self.given = given

    def at(self, t):
        return self.given


class Backwards(Own):
    duration = -0.5

    def __init__(self):
        super().__init__(Reference(*np.zeros((3, 2))))


def test_a_trajectory_of_ones_own_is_looked_at():
    good = Reference(*np.zeros((3, 2)))
    assert check_trajectory("trajectory", Own(good), 2).at(0.0) is good
    for reference, complaint in (
        (tuple(good), "must give a Reference at 0 s, but gives tuple"),
        (good._replace(velocity=[0.0, 0.0]), "must give arrays of 2 finite numbers, but its velocity at 0 s is"),
        (good._replace(acceleration=np.zeros(3)), "but its acceleration at 0 s is"),
        (good._replace(position=np.array([0.0, np.nan])), "but its position at 0 s is"),
    ):
        with pytest.raises(InvalidArgumentError, match=complaint):
            check_trajectory("trajectory", Own(reference), 2)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Sinusoid([1.0, 2.0], [1.0, 2.0, 3.0]), "amplitude: and the others must be scalars or of one length"),
        (lambda: Sinusoid(1.0, -1.0), "frequency: must be >= 0"),
        (lambda: Sinusoid(np.nan, 1.0), "amplitude: must be finite"),
        (lambda: MinimumJerk([0.0], [1.0], 0.0), "travel_time: must be > 0"),
        (lambda: MinimumJerk([0.0], [1.0, 2.0], 1.0), r"goal: must have shape \(1,\)"),
        (lambda: MinimumJerk(0.0, 1.0, 1.0), "origin: must be a vector"),
        (lambda: MinimumJerk([], [], 1.0), "origin: must be a vector"),
        (lambda: MinimumJerk.within_limits(PERA, PERA.home, PERA.home, fraction=0.0), "fraction: must be > 0"),
        (lambda: MinimumJerk.within_limits(PERA, PERA.home, PERA.home, fraction=-0.5), "fraction: must be > 0"),
        (lambda: CubicSpline([0.0, 0.0, 1.0], np.zeros((3, 2))), "times: must increase"),
        (lambda: CubicSpline([0.0, 1.0], np.zeros((3, 2))), r"times: must have shape \(3,\)"),
        (lambda: CubicSpline([0.0, 1.0], [1.0, 2.0]), "positions: must have shape"),
        (lambda: QuinticSpline([0.0], np.zeros((1, 2))), "positions: must hold at least 2 points, but holds 1"),
        (lambda: QuinticSpline(TIMES, WAYPOINTS + FINE[:7, None], periodic=True), "must end where they start"),
        (lambda: CubicSpline([0.0], [[1.0]]), "positions: must hold at least 2 points, but holds 1"),
        (lambda: CubicSpline([0.0, 1.0], np.zeros((2, 0))), "positions: must have shape"),
        (lambda: SampledTrajectory([0.0], [[1.0]]), "positions: must hold at least 2 points, but holds 1"),
        (lambda: SampledTrajectory(FINE[:4], MOTION[:4], smoothing=1.0), "at least 5 points"),
        (lambda: check_trajectory("trajectory", Backwards(), 2), "duration: must be >= 0"),
        (lambda: SampledTrajectory(FINE, MOTION, smoothing=-1.0), "smoothing: must be >= 0"),
        (lambda: SampledTrajectory(FINE[:3], MOTION[:3], smoothing=1.0), "at least 5 points"),
        (lambda: check_trajectory("trajectory", 3.0, 2), "trajectory: must be a trajectory"),
        (lambda: check_trajectory("trajectory", TRAJECTORIES["cubic"], 3), "must be for 3 joints, but is for 2"),
    ],
)
def test_bad_trajectories_are_refused(make, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        make()
