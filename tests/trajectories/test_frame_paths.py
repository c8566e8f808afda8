"""Paths of frames: twists against finite differences of poses, ends, waypoints, what is refused."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from phcontrol import (
    FigureOfEight,
    FrameArc,
    FrameLine,
    FramePath,
    FrameReference,
    FrameSpline,
    InvalidArgumentError,
    SampledFramePath,
    SlowedPath,
    UnknownNameError,
    load_robot,
)
from phcontrol.trajectories.frame_path import check_frame_path
from tests.finite_differences import derivative

PERA = load_robot("pera")


def turned(*angles):
    return Rotation.from_euler("xyz", angles).as_matrix()


FIRST, LAST = ([0.3, -0.2, 0.9], turned(0.3, -0.5, 1.0)), ([0.5, 0.1, 0.7], turned(-1.0, 0.4, 2.0))
TIMES = [0.5, 1.0, 1.8, 2.0, 3.1, 4.0, 4.5]
POINTS = 0.2 * np.array([[0, 0, 0], [1, 1, 0], [2, 1, 1], [1.8, 0, 1], [1, -1, 1], [0, -1, 0.5], [0, 0, 0]])
TURNS = [
    turned(0, 0, 0),
    *(turned(0.8 * np.sin(k), 0.5 * np.cos(2 * k), 0.4 * k) for k in range(1, 6)),
    turned(0, 0, 0),
]
WHOLE_TURN = [turned(0.0, 0.0, 2.0 * np.pi * k / 6.0) for k in range(7)]
POSES = list(zip(POINTS, TURNS, strict=True))
FINE = np.linspace(0.0, 4.0, 41)
SAMPLES = np.column_stack([np.sin(FINE), np.cos(2.0 * FINE), FINE])
SAMPLED_TURNS = Rotation.from_rotvec(np.column_stack([np.sin(FINE), 1.5 * FINE, np.cos(FINE)])).as_matrix()
PATHS = {
    "line": FrameLine("tool", FIRST, LAST, 2.5, start=0.5),
    "line_of_points": FrameLine("tool", FIRST[0], LAST[0], 2.5),
    "line_without_turn": FrameLine("tool", FIRST, (LAST[0], FIRST[1]), 2.0),
    "arc": FrameArc("tool", FIRST, [0.5, 0.0, 0.2], [0.1, -0.3, 2.0], 4.0, 3.0, start=1.0),
    "turning_arc": FrameArc("tool", FIRST, [0.5, 0.0, 0.2], [0.1, -0.3, 2.0], -7.0, 3.0, orientation="turning"),
    "arc_to_a_rotation": FrameArc("tool", FIRST, [0.5, 0.0, 0.2], [1.0, 0.0, 0.0], 2.0, 3.0, orientation=LAST[1]),
    "arc_through": FrameArc.through("tool", FIRST, [0.5, -0.3, 0.8], LAST, 3.0),
    "arc_of_points": FrameArc.through("tool", FIRST[0], [0.5, -0.3, 0.8], LAST[0], 3.0),
    "spline": FrameSpline("tool", POSES, TIMES),
    "spline_of_points": FrameSpline("tool", POINTS, TIMES),
    "spline_by_length": FrameSpline("tool", POSES, 6.0),
    "periodic_spline": FrameSpline("tool", POSES, TIMES, periodic=True),
    "whole_turn_spline": FrameSpline("tool", list(zip(POINTS, WHOLE_TURN, strict=True)), TIMES, periodic=True),
    "eight": FigureOfEight("tool", FIRST, 0.3, 0.2, 4.0, turn=0.8),
    "eight_of_points": FigureOfEight("tool", FIRST[0], 0.3, 0.2, 4.0, ramp=0.0),
    "eight_at_once": FigureOfEight("tool", FIRST, 0.3, 0.2, 4.0, turn=0.8, axis=[1.0, 1.0, 0.0], ramp=0.0),
    "samples": SampledFramePath("tool", FINE, SAMPLES, SAMPLED_TURNS),
    "smoothed": SampledFramePath("tool", FINE, SAMPLES, SAMPLED_TURNS, smoothing=1e-5),
    "sampled_points": SampledFramePath("tool", FINE, SAMPLES),
    "slowed": SlowedPath(FrameSpline("tool", POSES, TIMES), 1.7),
}
PERIODIC = {"periodic_spline": 4.0, "whole_turn_spline": 4.0, "eight_of_points": 4.0, "eight_at_once": 4.0}
FROM_REST = [
    name for name in PATHS if name not in PERIODIC and "sampled" not in name and name not in ("samples", "smoothed")
]
BREAKS = np.array([*TIMES, *FINE, *(1.7 * np.array(TIMES)), 0.5, 1.0, 2.0, 2.5, 3.0, 4.0])
BREAKS = np.array([*BREAKS, *(BREAKS + 4.0), *(BREAKS - 4.0)])


def spin(path, t, step=1e-3):
    """ω by central differences of fourth order: log(R(t + h) R(t)ᵀ) is odd in h to the order that counts."""
    here = path.at(t).rotation
    return derivative(lambda h: pin.log3(path.at(t + h).rotation @ here.T), step)


@pytest.mark.parametrize("name", list(PATHS))
@given(t=st.floats(-2.0, 8.0))
@example(t=4.494140625)  # away from one break it is at another
def test_twist_and_acceleration_are_the_derivatives(name, t):
    path, step = PATHS[name], 1e-3
    own = [*BREAKS, *PATHS["spline_by_length"].motion._breaks, 0.5 * path.duration]
    while min(abs(t - b) for b in own) < 2.5 * step:  # the third derivative may jump there
        t += 6.0 * step
    actual = path.at(t)
    rate = derivative(lambda h: path.at(t + h).position, step)
    np.testing.assert_allclose(actual.twist[:3], rate, atol=1e-7)
    if actual.rotation is not None:
        np.testing.assert_allclose(actual.rotation @ actual.rotation.T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(actual.twist[3:], spin(path, t), atol=1e-7)
    acceleration = derivative(lambda h: path.at(t + h).twist, step)
    np.testing.assert_allclose(actual.acceleration, acceleration, atol=5e-6)


@pytest.mark.parametrize("name", list(PATHS))
def test_everything_is_the_path_of_a_frame(name):
    path = PATHS[name]
    assert isinstance(path, FramePath)
    assert check_frame_path("path", path, PERA) is path
    assert path.frame == "tool"
    free = "point" in name
    reference = path.at(0.7)
    assert (reference.rotation is None) is free
    assert reference.twist.shape == reference.acceleration.shape == ((3,) if free else (6,))


@pytest.mark.parametrize("name", list(PATHS))
def test_paths_go_to_other_processes(name):
    there = pickle.loads(pickle.dumps(PATHS[name]))
    for here, copied in zip(PATHS[name].at(1.3), there.at(1.3), strict=True):
        np.testing.assert_array_equal(here, copied)


@pytest.mark.parametrize("name", list(PATHS))
def test_nothing_jumps_where_pieces_meet(name):
    """Position, twist and its derivative just before and just after each instant where something changes."""
    path = PATHS[name]
    ends = [0.0, path.duration] if name in ("samples", "smoothed", "sampled_points") else []
    for t in sorted({*TIMES, *(1.7 * np.array(TIMES)), 0.0, 0.5, 1.0, 3.0, 4.0, path.duration}):
        if t in ends:
            continue
        before, after = path.at(t - 1e-8), path.at(t + 1e-8)
        for quantity, tolerance in (("position", 1e-7), ("twist", 1e-6), ("acceleration", 2e-5)):
            np.testing.assert_allclose(getattr(before, quantity), getattr(after, quantity), atol=tolerance)
        if before.rotation is not None:
            way = 2e-8 * np.linalg.norm(before.twist[3:])
            np.testing.assert_allclose(before.rotation, after.rotation, atol=1.1 * way + 1e-14)


@pytest.mark.parametrize("name", FROM_REST)
def test_at_rest_before_and_after(name):
    path = PATHS[name]
    moments = [-1.0, 0.0] if name.startswith("eight") else [-1.0, 0.0, path.duration, 99.0]
    for t in moments:
        assert not path.at(t).twist.any()
        assert not path.at(t).acceleration.any()
    np.testing.assert_array_equal(path.at(-1.0).position, path.at(0.0).position)
    if len(moments) > 2:
        np.testing.assert_allclose(path.at(99.0).position, path.at(path.duration).position, atol=1e-15)


@pytest.mark.parametrize("name", list(PERIODIC))
@pytest.mark.parametrize("t", [0.0, 0.7, 3.99, -5.3])
def test_periods_repeat(name, t):
    path, period = PATHS[name], PERIODIC[name]
    assert path.duration == pytest.approx(period)
    for shift in (-2, 1, 3):
        for here, there in zip(path.at(t), path.at(t + shift * period), strict=True):
            if here is not None:
                np.testing.assert_allclose(here, there, atol=1e-9)


def test_a_line_is_straight_and_turns_as_slerp_does():
    path = PATHS["line"]
    slerp = Slerp([0.0, 1.0], Rotation.from_matrix([FIRST[1], LAST[1]]))
    way = np.subtract(LAST[0], FIRST[0])
    for t in np.linspace(0.5, 3.0, 11):
        tau = (t - 0.5) / 2.5
        s = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
        np.testing.assert_allclose(path.at(t).position, FIRST[0] + s * way, atol=1e-14)
        np.testing.assert_allclose(path.at(t).rotation, slerp(s).as_matrix(), atol=1e-13)
    assert path.duration == 3.0


def test_poses_may_be_given_in_four_ways():
    pose, matrix = pin.SE3(FIRST[1], np.array(FIRST[0])), np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = FIRST[1], FIRST[0]
    for origin in (pose, matrix, FIRST, list(FIRST)):
        start = FrameLine("tool", origin, LAST, 1.0).at(0.0)
        np.testing.assert_allclose(start.position, FIRST[0], atol=1e-15)
        np.testing.assert_allclose(start.rotation, FIRST[1], atol=1e-14)
    pose.translation[:] = 9.0
    np.testing.assert_array_equal(FrameLine("tool", FIRST, LAST, 1.0).at(0.0).position, FIRST[0])


@given(
    axis=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).filter(lambda u: np.linalg.norm(u) > 0.1),
    angle=st.floats(0.0, math.pi - 1.1e-3),
)
def test_a_line_ends_in_its_goals_orientation_whatever_the_turn(axis, angle):
    goal = Rotation.from_rotvec(angle * np.array(axis) / np.linalg.norm(axis)).as_matrix() @ FIRST[1]
    path = FrameLine("tool", FIRST, (LAST[0], goal), 1.0)
    np.testing.assert_allclose(path.at(1.0).rotation, goal, atol=1e-12)
    # the angle from the start grows with s, and is that of the shortest turn
    half = pin.log3(path.at(0.5).rotation @ np.array(FIRST[1]).T)
    assert np.linalg.norm(half) == pytest.approx(0.5 * angle, abs=1e-7)


@pytest.mark.parametrize("name", ["arc", "turning_arc", "arc_to_a_rotation"])
def test_an_arc_keeps_its_distance_from_the_axis(name):
    path = PATHS[name]
    axis = np.array([1.0, 0.0, 0.0] if name == "arc_to_a_rotation" else [0.1, -0.3, 2.0])
    axis /= np.linalg.norm(axis)

    def radial(t):
        way = path.at(t).position - [0.5, 0.0, 0.2]
        return way - axis * axis.dot(way)

    for t in np.linspace(0.0, path.duration, 13):
        np.testing.assert_allclose(np.linalg.norm(radial(t)), np.linalg.norm(radial(0.0)), atol=1e-14)
        assert axis.dot(path.at(t).position - FIRST[0]) == pytest.approx(0.0, abs=1e-14)
    angle = {"arc": 4.0, "turning_arc": -7.0, "arc_to_a_rotation": 2.0}[name]
    expected = Rotation.from_rotvec(angle * axis).as_matrix()
    np.testing.assert_allclose(radial(path.duration), expected @ radial(0.0), atol=1e-14)
    last = {"arc": FIRST[1], "turning_arc": expected @ FIRST[1], "arc_to_a_rotation": LAST[1]}[name]
    np.testing.assert_allclose(path.at(path.duration).rotation, last, atol=1e-13)


@given(via=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3))
def test_an_arc_goes_through_three_points_in_their_order(via):
    first, last = np.array(FIRST[0]), np.array(LAST[0])
    way = last - first
    if np.linalg.norm(np.cross(np.array(via) - first, way)) < 0.02:  # nearly on a line
        return
    path = FrameArc.through("tool", first, via, last, 1.0)
    np.testing.assert_allclose(path.at(0.0).position, first, atol=1e-12)
    np.testing.assert_allclose(path.at(1.0).position, last, atol=1e-9)
    points = np.array([path.at(t).position for t in np.linspace(0.0, 1.0, 501)])
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert np.linalg.norm(points - via, axis=1).min() < 2e-3 * length  # half of the longest step
    assert length < 2.0 * np.pi * np.linalg.norm(points - points.mean(axis=0), axis=1).max() * 1.2  # not round twice


@pytest.mark.parametrize("name", ["spline", "periodic_spline", "whole_turn_spline", "spline_of_points"])
def test_splines_pass_their_waypoints(name):
    turns = WHOLE_TURN if name == "whole_turn_spline" else TURNS
    for t, point, turn in zip(TIMES, POINTS, turns, strict=True):
        np.testing.assert_allclose(PATHS[name].at(t).position, point, atol=1e-12)
        if name != "spline_of_points":
            np.testing.assert_allclose(PATHS[name].at(t).rotation, turn, atol=1e-12)


def test_a_period_is_closed_wherever_it_starts():
    path = FrameSpline("tool", [(np.add(point, [0.5, -0.2, 0.9]), turn) for point, turn in POSES], TIMES, periodic=True)
    np.testing.assert_allclose(path.at(4.7).position, path.at(0.7).position, atol=1e-14)
    points = POINTS + np.linspace(0.3, -0.3, 7)[:, None]  # from a point to the one opposite of the world's origin
    with pytest.raises(InvalidArgumentError, match=r"must end where they start, but are 0\.6 apart"):
        FrameSpline("tool", list(zip(points, TURNS, strict=True)), TIMES, periodic=True)


def test_a_whole_turn_goes_on_turning():
    path = PATHS["whole_turn_spline"]
    angles = np.unwrap([np.arctan2(*path.at(t).rotation[[1, 0], 0]) for t in np.linspace(0.5, 12.5, 301)])
    assert angles[-1] - angles[0] == pytest.approx(6.0 * np.pi)


def test_times_are_shared_out_by_length():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 3, 0]])
    path = FrameSpline("tool", points, 8.0)
    np.testing.assert_allclose(path.at(2.0).position, points[1], atol=1e-12)
    assert path.duration == 8.0
    poses = [
        (np.zeros(3), turned(0, 0, 0)),
        (np.zeros(3), turned(0.5, 0, 0)),
        (np.array([0.3, 0, 0]), turned(0.5, 0, 0)),
    ]
    path = FrameSpline("tool", poses, 3.0, length=0.6)  # 0.3 m of turning, then 0.3 m
    np.testing.assert_allclose(path.at(1.5).rotation, poses[1][1], atol=1e-12)
    np.testing.assert_allclose(path.at(1.5).position, 0.0, atol=1e-12)


def test_a_splines_rotation_does_not_depend_on_the_axes_it_is_written_in():
    """Other axes of the world and of the frame: the curve between the waypoints is the same."""
    world, own = turned(0.4, -1.0, 2.0), turned(-2.0, 0.3, 0.9)
    other = FrameSpline("tool", [(point, world @ turn @ own) for point, turn in POSES], TIMES)
    for t in (0.8, 1.4, 2.6, 4.3):
        here, there = PATHS["spline"].at(t), other.at(t)
        np.testing.assert_allclose(there.rotation, world @ here.rotation @ own, atol=1e-12)
        np.testing.assert_allclose(there.twist[3:], world @ here.twist[3:], atol=1e-11)


def test_samples_are_passed_and_the_motion_between_is_found():
    path = PATHS["samples"]
    for t, turn, point in zip(FINE, SAMPLED_TURNS, SAMPLES, strict=True):
        np.testing.assert_allclose(path.at(t).rotation, turn, atol=1e-12)
        np.testing.assert_allclose(path.at(t).position, point, atol=1e-12)
    for t in np.linspace(0.3, 3.7, 40):
        expected = Rotation.from_rotvec([np.sin(t), 1.5 * t, np.cos(t)]).as_matrix()
        np.testing.assert_allclose(path.at(t).rotation, expected, atol=1e-5)
    # smoothing leaves the samples alone by little, and not by nothing
    away = max(
        np.abs(PATHS["smoothed"].at(t).rotation - turn).max() for t, turn in zip(FINE, SAMPLED_TURNS, strict=True)
    )
    assert 1e-6 < away < 1e-2


def test_a_figure_of_eight():
    """Through its centre twice a period, ±½w wide, ±½h high, turned by ±β, in the plane that is asked for."""
    path = PATHS["eight_at_once"]
    rows = [path.at(t) for t in np.linspace(0.0, 4.0, 401)]
    ways = np.array([row.position for row in rows]) - FIRST[0]
    np.testing.assert_allclose(np.abs(ways).max(axis=0), [0.0, 0.15, 0.1], atol=1e-9)
    np.testing.assert_allclose(ways[[0, 200, 400]], 0.0, atol=1e-14)
    turns = np.array([pin.log3(row.rotation @ np.array(FIRST[1]).T) for row in rows])
    np.testing.assert_allclose(turns[100], 0.8 / math.sqrt(2.0) * np.array([1.0, 1.0, 0.0]), atol=1e-9)
    assert np.linalg.norm(turns, axis=1).max() == pytest.approx(0.8)
    # after its ramp it is the same figure, half a ramp later
    for t in (1.0, 2.3, 17.0):
        np.testing.assert_allclose(
            PATHS["eight"].at(t + 0.5).position,
            FigureOfEight("tool", FIRST, 0.3, 0.2, 4.0, ramp=0.0).at(t).position,
            atol=1e-12,
        )
    assert PATHS["eight"].duration == 4.5


def test_a_slowed_path_is_the_same_path():
    fast, slow = PATHS["spline"], PATHS["slowed"]
    assert slow.duration == pytest.approx(1.7 * fast.duration)
    for t in (0.7, 2.2, 4.1):
        np.testing.assert_array_equal(slow.at(1.7 * t).rotation, fast.at(1.7 * t / 1.7).rotation)
        np.testing.assert_allclose(1.7 * slow.at(1.7 * t).twist, fast.at(t).twist, atol=1e-12)


class Own:
    """A path of the user's, which gives what it is told to."""

    frame, duration = "tool", 1.0

    def __init__(self, *given):
        self.given = given

    def at(self, t):
        return self.given[-1 if t else 0]


STILL = FrameReference(np.zeros(3), np.eye(3), np.zeros(6), np.zeros(6))
FREE = FrameReference(np.zeros(3), None, np.zeros(3), np.zeros(3))


def test_a_path_of_ones_own_is_looked_at():
    for good in (STILL, FREE):
        assert check_frame_path("path", Own(good)).at(0.0) is good
    for given_, complaint in (
        ([tuple(STILL)], "path: must give a FrameReference at 0 s, but gives tuple"),
        ([STILL._replace(twist=np.zeros(3))], r"of shape \(6,\), but its twist at 0 s is"),
        ([STILL._replace(position=[0.0, 0.0, 0.0])], "its position at 0 s is"),
        ([STILL._replace(acceleration=np.full(6, np.nan))], "its acceleration at 0 s is"),
        ([STILL._replace(rotation=2.0 * np.eye(3))], "must give rotation matrices, but at 0 s gives"),
        ([STILL._replace(rotation=np.diag([1.0, 1.0, -1.0]))], "must give rotation matrices"),
        ([STILL._replace(rotation=None)], "its twist at 0 s is"),
        ([FREE, STILL], r"its rotation at 1 s is|its twist at 1 s is"),
        ([STILL, FREE], "its rotation at 1 s is None"),
    ):
        with pytest.raises(InvalidArgumentError, match=complaint):
            check_frame_path("path", Own(*given_))


def test_a_path_is_judged_by_the_arm_that_shall_follow():
    with pytest.raises(UnknownNameError, match="unknown frame 'tolo' of pera.*'tool'"):
        check_frame_path("path", FrameLine("tolo", FIRST, LAST, 1.0), PERA)
    elbow = load_robot("pera_shoulder_elbow")
    with pytest.raises(InvalidArgumentError, match="a pose takes 6 joints, a position alone 3"):
        check_frame_path("path", PATHS["line"], elbow)
    check_frame_path("path", PATHS["line_of_points"], elbow)
    with pytest.raises(InvalidArgumentError, match="with 2 joints: a position takes 3 joints"):
        check_frame_path("path", PATHS["line_of_points"], load_robot("pera_shoulder"))


HALF_TURN = (LAST[0], turned(math.pi, 0, 0) @ FIRST[1])


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: FrameLine("", FIRST, LAST, 1.0), "frame: must be the name of a frame"),
        (lambda: FrameLine(3, FIRST, LAST, 1.0), "frame: must be the name of a frame"),
        (lambda: FrameLine("tool", FIRST, LAST, 0.0), "travel_time: must be > 0"),
        (lambda: FrameLine("tool", FIRST, LAST, 1.0, start=np.nan), "start: must be finite"),
        (lambda: FrameLine("tool", FIRST, LAST[0], 1.0), "goal: and origin must both be poses, or both be points"),
        (lambda: FrameLine("tool", FIRST[0], LAST, 1.0), "goal: and origin must both be poses"),
        (lambda: FrameLine("tool", FIRST, HALF_TURN, 1.0), "goal: is half a turn from .* which way round is not clear"),
        (
            lambda: FrameLine("tool", (FIRST[0], 2 * np.eye(3)), LAST, 1.0),
            "origin: must be a point .* its rotation is none",
        ),
        (
            lambda: FrameLine("tool", (FIRST[0], -np.eye(3)), LAST, 1.0),
            "origin: must be a point .* its rotation is none",
        ),
        (
            lambda: FrameLine("tool", (FIRST[0][:2], np.eye(3)), LAST, 1.0),
            "origin: must be a point .* a pair of shapes",
        ),
        (lambda: FrameLine("tool", FIRST, np.eye(3), 1.0), "goal: must be a point .* but has shape"),
        (lambda: FrameLine("tool", FIRST, [0.0, np.inf, 0.0], 1.0), "goal: must be finite"),
        (lambda: FrameArc("tool", FIRST, FIRST[0], [0, 0, 1], 1.0, 1.0), "center: must be on an axis that does not go"),
        (lambda: FrameArc("tool", FIRST, [0, 0, 0], [0, 0, 0], 1.0, 1.0), "axis: must be a direction"),
        (lambda: FrameArc("tool", FIRST, [0, 0, 0], [0, 1], 1.0, 1.0), "axis: must be a direction"),
        (lambda: FrameArc("tool", FIRST, [0, 0], [0, 0, 1], 1.0, 1.0), r"center: must have shape \(3,\)"),
        (lambda: FrameArc("tool", FIRST, [0, 0, 0], [0, 0, 1], np.inf, 1.0), "angle: must be finite"),
        (
            lambda: FrameArc("tool", FIRST, [0, 0, 0], [0, 0, 1], 1.0, 1.0, orientation="spinning"),
            "unknown orientation 'spinning'",
        ),
        (
            lambda: FrameArc("tool", FIRST[0], [0, 0, 0], [0, 0, 1], 1.0, 1.0, orientation="turning"),
            "orientation: is left free by an origin that is a point",
        ),
        (
            lambda: FrameArc("tool", FIRST[0], [0, 0, 0], [0, 0, 1], 1.0, 1.0, orientation=np.eye(3)),
            "orientation: is left free by an origin that is a point",
        ),
        (
            lambda: FrameArc("tool", FIRST, [0, 0, 0], [0, 0, 1], 1.0, 1.0, orientation=HALF_TURN[1]),
            "orientation: is half a turn",
        ),
        (lambda: FrameArc.through("tool", [0, 0, 0], [1, 1, 1], [2, 2, 2], 1.0), "via: must not lie on a line"),
        (lambda: FrameArc.through("tool", [0, 0, 0], [0, 0, 0], [2, 2, 2], 1.0), "via: must not lie on a line"),
        (lambda: FrameArc.through("tool", FIRST, [1, 1, 1], LAST[0], 1.0), "goal: and origin must both be"),
        (lambda: FrameSpline("tool", POSES[:1], 1.0), "waypoints: must be at least 2 poses, but are 1"),
        (lambda: FrameSpline("tool", POSES[:5], TIMES[:5], periodic=True), "must be at least 6 poses"),
        (lambda: FrameSpline("tool", [*POSES[:2], [0, 0, 0]], 1.0), "waypoints: must all be poses, or all points"),
        (lambda: FrameSpline("tool", POSES, TIMES[:-1]), r"times: must have shape \(7,\)"),
        (lambda: FrameSpline("tool", POSES, TIMES[::-1]), "times: must increase"),
        (lambda: FrameSpline("tool", POSES, 0.0), "times: must be > 0"),
        (lambda: FrameSpline("tool", POINTS[[0, 1, 1, 2]], 1.0), "waypoints: 1 and 2 are the same"),
        (
            lambda: FrameSpline("tool", [FIRST, HALF_TURN], 1.0),
            "waypoints: must not be half a turn apart, as number 0 and 1",
        ),
        (lambda: FrameSpline("tool", [*POSES[:-1], LAST], TIMES, periodic=True), "must end where they start"),
        (lambda: FrameSpline("tool", [FIRST, (LAST[0], np.ones((3, 3)))], 1.0), r"waypoints\[1\]: must be a point"),
        (lambda: SampledFramePath("tool", FINE, SAMPLES[:, :2]), r"positions: must have shape \(samples, 3\)"),
        (
            lambda: SampledFramePath("tool", FINE, SAMPLES, SAMPLED_TURNS[:-1]),
            r"rotations: must have shape \(41, 3, 3\)",
        ),
        (lambda: SampledFramePath("tool", FINE, SAMPLES, 2.0 * SAMPLED_TURNS), r"rotations\[0\]: must be a point"),
        (lambda: SampledFramePath("tool", FINE[::-1], SAMPLES), "times: must increase"),
        (lambda: SampledFramePath("tool", FINE, SAMPLES, smoothing=-1.0), "smoothing: must be >= 0"),
        (
            lambda: SampledFramePath("tool", [0.0, 1.0], SAMPLES[:2], [np.eye(3), np.diag([-1.0, -1.0, 1.0])]),
            "rotations: must not be half a turn apart, as number 0 and 1 are",
        ),
        (
            lambda: SampledFramePath(
                "tool", [0, 1, 1.1, 2, 3, 4], SAMPLES[:6], [turned(2.9 * k, 0, 0) for k in range(6)]
            ),
            "rotations: turn too far between two poses near",
        ),
        (lambda: FigureOfEight("tool", FIRST, 0.1, 0.1, 0.0), "period: must be > 0"),
        (lambda: FigureOfEight("tool", FIRST, 0.1, 0.1, 1.0, ramp=-1.0), "ramp: must be >= 0"),
        (lambda: FigureOfEight("tool", FIRST, 0.1, 0.1, 1.0, across=[0, 2, 0]), "across: must not be parallel"),
        (lambda: FigureOfEight("tool", FIRST[0], 0.1, 0.1, 1.0, turn=0.5), "turn: needs a pose"),
        (lambda: SlowedPath(PATHS["line"], 0.0), "factor: must be > 0"),
        (lambda: SlowedPath(3.0, 1.0), "path: must be the path of a frame"),
        (
            lambda: check_frame_path("path", type("Backwards", (Own,), {"duration": -1.0})(STILL)),
            "duration: must be >= 0",
        ),
    ],
)
def test_bad_paths_are_refused(make, complaint):
    with pytest.raises((InvalidArgumentError, UnknownNameError), match=f"(?s){complaint}"):
        make()
