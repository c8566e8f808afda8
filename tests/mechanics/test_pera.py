"""The shipped robots against the thesis's closed forms and against yourdfpy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yourdfpy

from phcontrol import MechanicalSystem, load_robot
from phcontrol.thesis import appendix_a
from tests.conftest import SHIPPED, make_system

EXACT = 1e-12  # sums of some thirty products of numbers of order one


def test_mass_matrix_and_gravity_of_pera_are_those_of_appendix_a(pera, rng):
    for q in rng.uniform(-np.pi, np.pi, size=(50, 7)):
        x = pera.at(q)
        np.testing.assert_allclose(x.mass_matrix, appendix_a.mass_matrix(q), atol=EXACT, rtol=0)
        np.testing.assert_allclose(x.potential_gradient, appendix_a.potential_gradient(q), atol=EXACT, rtol=0)


def test_the_misprint_of_appendix_a_would_be_noticed(pera, rng):
    """E1 as printed: d²m₇c₂²c₄² with the wrong sign, and c₃²c₄² cancelling itself."""
    q = rng.uniform(-np.pi, np.pi, size=7)
    c2, c3, c4 = np.cos(q[1:4])
    d, m6, m7 = appendix_a.D5, appendix_a.M[6], appendix_a.M[7]
    correct = d**2 * (m6 + m7) * (-(c2**2) * c4**2 + c3**2 * c4**2)
    printed = -(d**2) * m6 * c2**2 * c4**2 + d**2 * m7 * c2**2 * c4**2
    as_printed = appendix_a.mass_matrix(q)[0, 0] - correct + printed
    assert abs(pera.at(q).mass_matrix[0, 0] - as_printed) > 1e-4


def test_shoulder_is_example_2_1_2(shoulder, rng):
    mass, length, first, second, g = 3.9, 0.249, 0.013, 1.692, 9.81
    for q in rng.uniform(-np.pi, np.pi, size=(20, 2)):
        x = shoulder.at(q)
        a = mass * length**2 * np.cos(q[1]) ** 2 + first + second  # (2.10)
        b = mass * length**2 + second  # (2.11)
        gravity = g * mass * length * np.array([np.cos(q[1]) * np.sin(q[0]), np.sin(q[1]) * np.cos(q[0])])  # (2.12)
        np.testing.assert_allclose(x.mass_matrix, np.diag([a, b]), atol=EXACT)
        np.testing.assert_allclose(x.potential_gradient, gravity, atol=EXACT)
        np.testing.assert_allclose(x.factor, np.diag(np.sqrt([a, b])), atol=EXACT)  # (2.42)


def test_shoulder_and_elbow_has_the_gravity_of_section_5_4(rng):
    """(5.51), with the centre of mass of link 2 at a_C2 = 0.16 m."""
    system = make_system("pera_shoulder_elbow")
    g, m2, m3, a2, ac2, ac3 = 9.81, 2.9, 1.0, 0.32, 0.16, 0.14
    for q1, q2, q3 in rng.uniform(-np.pi, np.pi, size=(20, 3)):
        expected = [
            g * np.sin(q1) * (ac2 * m2 * np.cos(q2) + m3 * (a2 * np.cos(q2) + ac3 * np.cos(q2 + q3))),
            g * np.cos(q1) * (ac2 * m2 * np.sin(q2) + m3 * (a2 * np.sin(q2) + ac3 * np.sin(q2 + q3))),
            m3 * g * ac3 * np.cos(q1) * np.sin(q2 + q3),
        ]
        np.testing.assert_allclose(system.at([q1, q2, q3]).potential_gradient, expected, atol=EXACT)


def test_gripper_has_constant_inertia_and_no_weight(rng):
    robot = load_robot("pera_gripper")
    without_spring = MechanicalSystem(robot)
    for q in rng.uniform(0.0, 1.2, size=(5, 1)):
        x = without_spring.at(q)
        np.testing.assert_allclose(x.mass_matrix, [[0.5]], atol=EXACT)
        np.testing.assert_allclose(x.gravity, [0.0], atol=EXACT)


def test_gripper_fingers_open_symmetrically():
    robot = load_robot("pera_gripper")
    left, right = (robot.placement(f"{side}_finger", [0.8]).rotation for side in ("left", "right"))
    np.testing.assert_allclose(left, right.T, atol=EXACT)
    opening = np.arccos(left[0, 0]) + np.arccos(right[0, 0])
    assert opening == pytest.approx(0.8)  # q is the angle between the fingertips


@pytest.mark.parametrize("name", SHIPPED)
def test_forward_kinematics_agree_with_yourdfpy(name, rng):
    robot = load_robot(name)
    other = yourdfpy.URDF.load(str(robot.path), load_meshes=False, build_scene_graph=True)
    for _ in range(10):
        q = robot.random_position(rng)
        other.update_cfg(dict(zip(robot.joint_names, q, strict=True)))
        for frame in robot.frame_names:
            if frame == "universe":
                continue
            expected = other.get_transform(frame)
            np.testing.assert_allclose(robot.placement(frame, q).homogeneous, expected, atol=1e-9)


@pytest.mark.parametrize("name", SHIPPED)
def test_inertia_is_positive_definite_everywhere(name, rng):
    system = make_system(name)
    for _ in range(200):
        q = rng.uniform(-np.pi, np.pi, size=system.n)
        assert np.linalg.eigvalsh(system.at(q).mass_matrix)[0] > 1e-3


@pytest.mark.parametrize("name", SHIPPED)
def test_every_link_that_moves_is_visible_and_every_joint_has_limits(name):
    robot = load_robot(name)
    links = yourdfpy.URDF.load(str(robot.path), load_meshes=False).link_map
    frames = {robot.tool_frame}
    assert all(link.visuals for link_name, link in links.items() if link_name not in frames)
    assert np.isfinite([robot.lower, robot.upper, robot.velocity_limit, robot.effort_limit]).all()
    assert (robot.lower <= robot.home).all()
    assert (robot.home <= robot.upper).all()


def test_urdf_files_are_up_to_date_with_their_table():
    script = Path(__file__).parents[2] / "urdf" / "generate.py"
    assert subprocess.run([sys.executable, script, "--check"], check=False).returncode == 0


def test_the_arm_with_gripper_is_both(rng):
    """The motor's inertia is felt at its own joint alone, and so is the spring; the rest is the arm."""
    both, gripper = make_system("pera_with_gripper"), make_system("pera_gripper")
    q = both.robot.random_position(rng)
    x = both.at(q)
    fingers = 1e-4  # the links that the shaft turns
    assert x.mass_matrix[7, 7] == pytest.approx(0.5 + fingers, abs=EXACT)
    assert np.abs(x.mass_matrix[7, :7]).max() <= fingers + EXACT
    spring = x.potential_gradient - x.gravity
    np.testing.assert_allclose(spring[:7], 0.0, atol=EXACT)
    assert spring[7] == pytest.approx(gripper.at(q[7:]).potential_gradient[0], abs=EXACT)
    locked = MechanicalSystem(load_robot("pera_with_gripper", locked_joints=["gripper"]))
    alone = make_system("pera").at(q[:7]).mass_matrix
    assert np.abs(locked.at(q[:7]).mass_matrix - alone).max() < 0.05 * np.abs(alone).max()  # 0.05 kg of fingers


def test_a_joint_locked_in_a_shipped_robot_leaves_the_others_as_they_are():
    whole = load_robot("pera_shoulder_elbow")
    elbow = load_robot("pera_shoulder_elbow", locked_joints=[whole.joint_names[0]])
    np.testing.assert_array_equal(elbow.home, whole.home[1:])
    assert elbow.locked_joints == {whole.joint_names[0]: whole.home[0]}
    for part in ("static", "coulomb", "viscous", "stribeck_velocity"):
        np.testing.assert_array_equal(getattr(elbow.friction, part), getattr(whole.friction, part)[1:])
    np.testing.assert_allclose(
        elbow.placement("tool", elbow.home).homogeneous, whole.placement("tool", whole.home).homogeneous, atol=EXACT
    )


def test_the_jacobians_of_section_5_4_and_their_misprints(rng):
    """(5.56), (5.57) in the axes of DH frame 0, of the centre of mass of link 3; errata E21."""
    system = make_system("pera_shoulder_elbow")
    a2, a3 = 0.32, 0.14
    base = system.at(np.zeros(3)).placement("shoulder").rotation
    for q1, q2, q3 in rng.uniform(-np.pi, np.pi, size=(10, 3)):
        x = system.at([q1, q2, q3])
        jacobian = x.frame_jacobian("forearm", "local_world_aligned")
        arm = x.placement("forearm").rotation @ [a3, 0.0, 0.0]
        angular = base.T @ jacobian[3:]
        linear = base.T @ (jacobian[:3] + np.cross(jacobian[3:].T, arm).T)
        s1, c1, s2, c2 = np.sin(q1), np.cos(q1), np.sin(q2), np.cos(q2)
        s23, c23 = np.sin(q2 + q3), np.cos(q2 + q3)
        reach, height = a2 * c2 + a3 * c23, a2 * s2 + a3 * s23
        np.testing.assert_allclose(angular, [[0, s1, s1], [0, -c1, -c1], [1, 0, 0]], atol=EXACT)
        np.testing.assert_allclose(
            linear,
            [
                [-s1 * reach, -c1 * height, -a3 * c1 * s23],
                [c1 * reach, -s1 * height, -a3 * s1 * s23],
                [0.0, reach, a3 * c23],
            ],
            atol=EXACT,
        )
