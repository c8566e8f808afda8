"""Cases at the edges: massless links with rotors, singular postures, branches, one joint."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import MechanicalSystem, RobotDescriptionError, load_robot
from phcontrol.mechanics.singular_damping import SingularDamping, frame_damping
from phcontrol.mechanics.transformations import PassivityCheck
from phcontrol.mechanics.urdf import Findings
from tests.conftest import make_system

LINK = '<link name="{}"><inertial><mass value="{}"/><inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>'
JOINT = (
    '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>'
    '<limit lower="-2" upper="2" velocity="3" effort="10"/></joint>'
)
FIXED = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/><origin xyz="0.2 0 0.1"/></joint>'


def link(name, mass=1.0, moment=0.01):
    return LINK.format(name, mass, i=moment) + "</inertial></link>"


def robot_of(tmp_path, *parts, **options):
    path = tmp_path / "arm.urdf"
    path.write_text('<robot name="arm"><link name="base"/>' + "".join(parts) + "</robot>")
    return load_robot(path, **options)


def test_a_rotor_makes_up_for_a_link_without_mass(tmp_path):
    parts = link("l1"), '<link name="l2"/>', JOINT.format("j1", "base", "l1"), JOINT.format("j2", "l1", "l2")
    with pytest.raises(RobotDescriptionError, match="joint 'j2' has no mass"):
        robot_of(tmp_path, *parts)
    robot = robot_of(tmp_path, *parts, armature={"j2": 0.1})
    assert MechanicalSystem(robot).at([0.0, 0.0]).mass_matrix[1, 1] == pytest.approx(0.1)


def test_moments_in_kg_mm2_are_doubted(tmp_path, recwarn):
    parts = link("l1", moment=5e4), JOINT.format("j1", "base", "l1")
    robot_of(tmp_path, *parts)
    assert any("radius of gyration is more than" in str(warning.message) for warning in recwarn)


def test_the_hand_is_moved_by_all_joints(tmp_path):
    """Frames of a branch that fewer joints move do not count, however many axes they move along."""
    parts = (
        link("l1"), link("l2"), '<link name="tip"/>', '<link name="camera"/>', JOINT.format("j1", "base", "l1"),
        JOINT.format("j2", "l1", "l2"), FIXED.format("a_tip", "l2", "tip"), FIXED.format("z_camera", "l1", "camera"),
    )  # fmt: skip
    robot = robot_of(tmp_path, *parts)
    assert robot.tool_frame in (None, "")
    assert MechanicalSystem(robot).hand_frame == "tip"


@pytest.mark.parametrize(("arm", "n"), [("pera_gripper", 1), ("pera", 7)])
def test_a_frames_jacobian_has_six_rows(arm, n):
    system = make_system(arm)
    frame = system.robot.frame_names[-1]
    assert system.at(system.robot.near_home()).frame_kinematics(frame).jacobian.shape == (6, n)


def test_manipulability_at_singularities_is_zero_to_rounding():
    """Two joints move a point in a plane: det 𝒥𝒥ᵀ of three rows is 0, and rounding leaves it below at times."""
    system, found = make_system("pera_shoulder"), []
    frame = system.hand_frame
    generator = np.random.default_rng(1)
    for position in generator.uniform(-1.0, 1.0, (200, 2)):
        task = system.at(position).task_space(frame, 3)
        found.append(task.manipulability)
        assert 0.0 <= task.clearance <= 1.0
        determinants = np.linalg.det(task.jacobian @ task.jacobian.T)
        assert task.manipulability == pytest.approx(max(determinants, 0.0) ** 0.5, abs=1e-12)
    assert max(found) < 1e-7


def test_damping_begins_where_the_smallest_singular_value_says():
    """However the matrix is turned: the fast bound must not call near what is far."""
    generator, region = np.random.default_rng(2), 0.1
    damping = SingularDamping(0.05, region, np.eye(3))
    near = 0
    for _ in range(300):
        turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
        sizes = np.array([generator.uniform(0.02, 0.3), 1.0, generator.uniform(0.5, 2.0)])
        square = turn @ np.diag(sizes**2) @ turn.T
        assert (damping.at(square) is not None) == (sizes[0] < region)
        near += sizes[0] < region
    assert near > 50


def test_the_weight_of_a_frames_damping_fits_its_rows():
    np.testing.assert_allclose(frame_damping(3).weight, np.eye(3))
    ratios = np.diag(frame_damping(6, length=0.5).weight) / frame_damping(6, length=0.5).weight[0, 0]
    np.testing.assert_allclose(ratios, [1.0, 1.0, 1.0, 4.0, 4.0, 4.0])


@pytest.mark.parametrize(("lowest", "growth", "passed"), [(0.0, 0.0, True), (-1.0, 0.0, False), (0.0, 1.0, False)])
def test_passivity_asks_for_a_storage_that_is_not_negative(lowest, growth, passed):
    assert PassivityCheck(1, growth, lowest, 0.0, 0.0).passed is passed


@pytest.mark.parametrize(("count", "more"), [(2, ""), (20, ""), (21, "\n  and 1 more")])
def test_as_many_problems_are_listed_as_are_shown(count, more):
    findings = Findings("arm.urdf")
    for line in range(1, count + 1):
        findings.add(line, "bad")
    with pytest.raises(RobotDescriptionError) as caught:
        findings.check()
    assert str(caught.value).endswith(f"line {min(count, 20)}: bad{more}")
