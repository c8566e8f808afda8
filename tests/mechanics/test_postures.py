"""Postures of a robot: wrapped differences, a step from home, names; where descriptions are looked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import InvalidArgumentError, RobotDescriptionError, UnknownNameError, load_robot
from phcontrol.mechanics import catalogue
from phcontrol.mechanics.derivatives import cross_matrices, lower_half, motion_cross_products, right_inverse
from phcontrol.mechanics.derivatives import right_inverse_derivative as inverse_derivative
from phcontrol.mechanics.robot import check_joint_names, wrapped
from tests.conftest import ARMS, make_system


@given(st.floats(-50.0, 50.0))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    there = float(wrapped(np.array(angle)))
    assert -np.pi < there <= np.pi
    assert np.exp(1j * there) == pytest.approx(np.exp(1j * angle), abs=1e-12)


def test_half_a_turn_stays_positive():
    np.testing.assert_array_equal(wrapped(np.array([np.pi, -np.pi, 0.0, 1.0])), [np.pi, np.pi, 0.0, 1.0])


def test_only_continuous_joints_are_wrapped():
    robot = load_robot("kinova")
    assert robot.continuous.any()
    assert not robot.continuous.all()
    error = robot.difference(robot.home + 6.0, robot.home)
    np.testing.assert_allclose(error, np.where(robot.continuous, 6.0 - 2.0 * np.pi, 6.0), atol=1e-12)


@pytest.mark.parametrize("arm", [*ARMS, "tiago_no_hand"])
def test_near_home_is_a_step_away_inside_the_limits(arm):
    robot = make_system(arm).robot if arm in ARMS else load_robot(arm)
    step = robot.near_home() - robot.home
    longest = np.where(np.array(robot.prismatic or [False] * robot.n), 0.05, 0.4)
    assert (robot.home >= robot.lower).all()
    assert (robot.home <= robot.upper).all()
    assert (np.abs(step) <= longest + 1e-12).all()
    assert (robot.near_home() >= robot.lower).all()
    assert (robot.near_home() <= robot.upper).all()
    assert (step != 0.0).all()


def test_near_home_goes_towards_the_middle_of_the_limits():
    robot = load_robot("pera_shoulder_elbow")
    for lower, upper, home, expected in [
        (-2.0, 2.0, 1.0, 0.6),
        (-2.0, 2.0, -1.0, -0.6),
        (-2.0, 2.0, 0.0, 0.4),
        (-2.0, 2.0, 0.3, 0.0),
        (-0.1, 0.1, 0.0, 0.1),
        (-np.inf, np.inf, 0.5, 0.9),
        (-np.inf, 0.6, 0.5, 0.6),
    ]:
        told = replace(robot, **{n: np.full(3, v) for n, v in (("lower", lower), ("upper", upper), ("home", home))})
        np.testing.assert_allclose(told.near_home(), np.full(3, expected), atol=1e-12)
        np.testing.assert_array_equal(replace(told, prismatic=()).near_home(), told.near_home())
    sliding = replace(
        robot, lower=np.zeros(3), upper=np.full(3, 0.4), home=np.full(3, 0.1), prismatic=(True, False, True)
    )
    np.testing.assert_allclose(sliding.near_home(), [0.15, 0.2, 0.15], atol=1e-12)


def test_positions_by_name_leave_the_others_at_home():
    robot = load_robot("pera")
    name = robot.joint_names[2]
    expected = np.array(robot.home)
    expected[2] = 0.25
    np.testing.assert_array_equal(robot.position({name: 0.25}), expected)
    np.testing.assert_array_equal(robot.position(expected), expected)
    with pytest.raises(UnknownNameError, match="unknown joint 'elbw' of pera"):
        robot.position({"elbw": 0.0})
    for names in (["elbw"], [3], [name, "elbw"]):
        with pytest.raises(UnknownNameError, match="unknown joint .* of pera"):
            check_joint_names(names, robot.joint_names, "pera")
    check_joint_names([name], robot.joint_names, "pera")


def test_frames_are_named_and_joints_are_not_among_them(pera):
    robot = pera.robot
    assert {"tool", "camera"} <= set(robot.frame_names)
    assert not set(robot.joint_names) & set(robot.frame_names)
    for name in robot.frame_names:
        assert robot.model.frames[robot.frame_id(name)].name == name
    for name in ("tol", 3, None, ["tool"]):
        with pytest.raises(UnknownNameError, match="unknown frame"):
            pera.frame_id(name)
    assert repr(robot) == "<Robot pera: 7 joints>"
    assert repr(pera) == "<MechanicalSystem pera: 7 joints>"


def test_positions_and_velocities_come_as_arrays_or_as_lists(pera):
    q, v = np.linspace(0.1, 0.7, 7), np.linspace(-1.0, 1.0, 7)
    expected = pera.at(q, v)
    for position in (q, q.tolist(), tuple(q)):
        for velocity in (v, v.tolist(), tuple(v)):
            x = pera.at(position, velocity)
            np.testing.assert_array_equal(x.position, expected.position)
            np.testing.assert_array_equal(x.velocity, expected.velocity)
    for position, velocity in [(q[:6], v), (q, v[:6]), (np.full(7, np.nan), v), (q, np.full(7, -np.inf)), (q[None], v)]:
        with pytest.raises(InvalidArgumentError, match="position: must|velocity: must"):
            pera.at(position, velocity)
    np.testing.assert_array_equal(pera.at(q).velocity, np.zeros(7))


def test_a_mass_matrix_that_is_none_is_refused_where_it_is(shoulder):
    x = shoulder.at([0.1, 0.2])
    x.__dict__["mass_matrix"] = np.diag([1.0, -1.0])
    with pytest.raises(InvalidArgumentError, match=r"the mass matrix is not positive definite at \[0\.1 0\.2\]"):
        _ = x.factor


def test_the_pose_of_a_frame_follows_mimic_joints(rng):
    for arm in ("pera", "panda_with_fingers"):
        system = make_system(arm)
        q, frame = system.robot.random_position(rng), "tool" if arm == "pera" else "panda_rightfinger"
        expected = system.at(q).placement(frame)
        np.testing.assert_allclose(system.robot.placement(frame, q).homogeneous, expected.homogeneous, atol=1e-12)
        record = system.robot.record()
        assert record["joint_names"] == list(system.robot.joint_names)
        assert record["name"] == system.robot.name


@pytest.mark.parametrize("source", ["some/where/arm", "arm.urdf", "arm.xml", Path("arm")])
def test_what_looks_like_a_path_is_one(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RobotDescriptionError, match=": no such file"):
        catalogue.find(source)
    path = tmp_path / "own.xml"
    path.write_text("<robot/>")
    found = catalogue.find(str(path))
    assert (found.name, found.path, found.package_directories) == ("own", path, (tmp_path,))
    assert not found.has_rotor_parameters
    assert found.extras == {}


def test_what_is_no_path_is_a_name():
    with pytest.raises(
        UnknownNameError, match=r"unknown robot 'pear'; a path to a URDF, xacro or MJCF file works too\. Did you mean"
    ):
        catalogue.find("pear")
    floating = next(name for name, free in catalogue.example_robots().items() if free)
    with pytest.raises(RobotDescriptionError, match="has a floating base"):
        catalogue.find(floating)
    pera = catalogue.find("pera")
    assert pera.path.name == "pera.urdf"
    assert pera.path.is_file()
    assert pera.extras["title"] == catalogue.shipped_robots()["pera"]


vectors = st.lists(st.floats(-3.0, 3.0), min_size=18, max_size=18).map(lambda v: np.reshape(v, (6, 3)))


@given(vectors)
def test_cross_products_of_vectors_and_of_motions(twists):
    for matrix, vector in zip(cross_matrices(twists[:3]), twists[:3].T, strict=True):
        np.testing.assert_allclose(matrix @ [1.0, 2.0, -3.0], np.cross(vector, [1.0, 2.0, -3.0]), atol=1e-12)
    products = motion_cross_products(twists)
    for k in range(3):
        for i in range(3):  # (v, ω) × (v', ω') = (ω × v' + v × ω', ω × ω')
            v, w, v_, w_ = twists[:3, i], twists[3:, i], twists[:3, k], twists[3:, k]
            expected = np.r_[np.cross(w, v_) + np.cross(v, w_), np.cross(w, w_)]
            np.testing.assert_allclose(products[k, :, i], expected, atol=1e-12)


def test_the_lower_half_with_its_transpose_is_a_symmetric_matrix(rng):
    for shape in ((4, 4), (3, 4, 4)):
        matrix = rng.normal(size=shape)
        matrix = matrix + np.swapaxes(matrix, -1, -2)
        half = lower_half(matrix)
        assert not np.triu(half, 1).any()
        np.testing.assert_allclose(half + np.swapaxes(half, -1, -2), matrix, atol=1e-12)


def test_singular_matrices_have_no_right_inverse():
    singular = np.zeros((2, 3))
    assert np.isnan(right_inverse(singular)).all()
    assert right_inverse(singular).shape == (3, 2)
    assert np.isnan(inverse_derivative(singular, np.ones((2, 3)))).all()
