"""Loading: what is accepted, what is refused, and with which words."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    InvalidArgumentError,
    MechanicalSystem,
    RobotDescriptionError,
    RobotDescriptionWarning,
    UnknownNameError,
    load_robot,
)
from tests.conftest import FINGERS

INERTIAL = '<inertial><mass value="{mass}"/><inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="2"/>'


def urdf(tmp_path, joint_type="revolute", mass=1.0, moment=0.1, extra="", limit=LIMIT):
    path = tmp_path / "arm.urdf"
    path.write_text(
        f'<robot name="arm"><link name="base"/><link name="hand">{INERTIAL.format(mass=mass, i=moment)}</link>'
        f'<joint name="elbow" type="{joint_type}"><parent link="base"/><child link="hand"/>'
        f'<axis xyz="1 0 0"/>{limit}</joint>{extra}</robot>'
    )
    return path


def test_a_file_by_path_or_string(tmp_path):
    path = urdf(tmp_path)
    for source in (path, str(path)):
        robot = load_robot(source)
        assert robot.joint_names == ("elbow",)
        assert (robot.lower[0], robot.upper[0], robot.effort_limit[0], robot.velocity_limit[0]) == (-1, 1, 5, 2)


def test_a_name_of_example_robot_data_with_locked_joints():
    robot = load_robot("panda", locked_joints=FINGERS)
    assert robot.n == 7
    np.testing.assert_allclose(robot.home[:2], [0.0, -0.785398])
    assert load_robot("panda", locked_joints={"panda_joint1": 0.5, FINGERS[0]: 0.02}).locked_joints == {
        "panda_joint1": 0.5,
        FINGERS[0]: 0.02,
        FINGERS[1]: 0.02,  # follows the first finger
    }


def test_a_name_whose_files_are_not_installed_is_refused(monkeypatch):
    def missing(subpath):
        raise OSError(f"{subpath} not found")

    monkeypatch.setattr("example_robot_data.robots_loader.getModelPath", missing)
    with pytest.raises(RobotDescriptionError, match="ur5: its files are not installed: pip install example-robot-data"):
        load_robot("ur5")


def test_rotor_inertia_of_a_description_is_used():
    system = MechanicalSystem(load_robot("talos_arm"))
    assert system.model.armature.sum() == pytest.approx(0.6)


def test_a_prismatic_joint(tmp_path):
    system = MechanicalSystem(load_robot(urdf(tmp_path, "prismatic")))
    np.testing.assert_allclose(system.at([0.0]).mass_matrix, [[1.0]])


def test_a_continuous_joint_is_one_angle_without_limits(tmp_path):
    with pytest.warns(RobotDescriptionWarning, match="no (effort|velocity) limit, or 0, for elbow") as caught:
        robot = load_robot(urdf(tmp_path, "continuous", limit=""))
    assert len(caught) == 2
    assert robot.n == robot.model.nq == 1
    assert robot.upper[0] == np.inf
    assert robot.effort_limit[0] == np.inf


def test_dry_and_viscous_friction_of_the_file_are_used(tmp_path):
    robot = load_robot(urdf(tmp_path, limit=LIMIT + '<dynamics damping="0.5" friction="0.2"/>'))
    np.testing.assert_allclose(robot.friction.coefficients(np.array([100.0])), 0.5 + 0.2 / 100.0, rtol=1e-6)


def test_mimic_joints_follow_exactly(rng):
    """The coupled arm moves as the free arm would with the follower held to its leader."""
    free = load_robot("pera")
    coupled = MechanicalSystem(load_robot("panda"))
    assert coupled.robot.n == 8
    q = coupled.robot.random_position(rng)
    full = coupled.robot.full_position(q)
    names = list(coupled.model.names)[1:]
    assert full[names.index(FINGERS[0])] == full[names.index(FINGERS[1])] == q[-1]
    assert free.coupling is None


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (None, "no such file"),
        ("<robot", "not well-formed XML"),
        ("", "not well-formed XML"),
        ("<model/>", "the root element is <model>, not <robot>"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot name="x"/>', "document type declaration"),
        ('<robot name="x"/>', r"broken\.urdf, has no link$"),
        ('<robot name="x"><link name="a"/></robot>', r"broken\.urdf, has no moving joint$"),
        (b"\xff\xfe\x00", "cannot be read"),
    ],
)
def test_broken_files_are_refused(tmp_path, content, complaint):
    path = tmp_path / "broken.urdf"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RobotDescriptionError, match=complaint):
        load_robot(path)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"mass": 0.0, "moment": 0.0}, "what moves with joint 'elbow' has no mass or inertia.*locked_joints"),
        ({"mass": -1.0}, "mass -1 kg"),
        ({"moment": -0.1}, "none may be negative"),
        ({"joint_type": "floating"}, "joint 'elbow' is floating"),
        ({"joint_type": "planar"}, "joint 'elbow' is planar"),
    ],
)
def test_arms_that_cannot_be_controlled_are_refused(tmp_path, arguments, complaint):
    with pytest.raises(RobotDescriptionError, match=complaint):
        load_robot(urdf(tmp_path, **arguments))


def test_a_follower_of_nothing_is_refused(tmp_path):
    extra = (
        f'<link name="tip">{INERTIAL.format(mass=1, i=0.1)}</link><joint name="tip_joint" type="revolute">'
        f'<parent link="hand"/><child link="tip"/><axis xyz="1 0 0"/>{LIMIT}<mimic joint="nobody"/></joint>'
    )
    with pytest.raises(RobotDescriptionError, match="'tip_joint' mimics 'nobody'"):
        load_robot(urdf(tmp_path, extra=extra))


def test_floating_bases_and_unknown_names_are_refused(tmp_path):
    with pytest.raises(RobotDescriptionError, match="solo12: has a floating base"):
        load_robot("solo12")
    with pytest.raises(UnknownNameError, match=r"unknown robot 'perra'.*Did you mean 'pera'\?.*pera_gripper.*ur5"):
        load_robot("perra")
    with pytest.raises(UnknownNameError, match=r"unknown joint 'finger' of panda.*panda_joint1"):
        load_robot("panda", locked_joints=["finger"])
    with pytest.raises(InvalidArgumentError, match="must be a list of joint names, but is the string"):
        load_robot("panda", locked_joints="panda_joint1")
    with pytest.raises(InvalidArgumentError, match="must leave at least one joint free"):
        load_robot("pera_shoulder", locked_joints=["shoulder_pitch", "shoulder_roll"])


@pytest.mark.parametrize("armature", [-0.1, np.nan, [0.1, 0.2, 0.3]])
def test_bad_armature_is_refused(armature):
    with pytest.raises(InvalidArgumentError, match="armature: must"):
        load_robot("pera_shoulder", armature=armature)


def test_positions_by_joint_name(pera):
    position = pera.robot.position({"elbow_pitch": -1.0})
    assert position[3] == -1.0
    np.testing.assert_array_equal(np.delete(position, 3), np.delete(pera.robot.home, 3))
    with pytest.raises(UnknownNameError, match="unknown joint 'elbow' of pera"):
        pera.robot.position({"elbow": 1.0})
