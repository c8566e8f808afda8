"""Where arms start: inside their limits, above the floor, not stretched; and on the way from there to near it."""

from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import MechanicalSystem, load_robot
from phcontrol.mechanics import catalogue

STANDING = ["pera", "pera_shoulder_elbow", "pera_with_gripper", "panda", "ur3", "ur5", "ur10", "kinova", "xarm7", "z1"]
FULL_POSE = ["panda", "ur3", "ur5", "ur10", "kinova", "xarm7", "z1"]
NAMED = sorted(catalogue.homes())


def described(name):
    """Return an arm as it is described, whatever is strange about it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_robot(name)


def lowest(robot, position):
    """Return the height of the lowest vertex of all links that move [m]."""
    model, data = robot.model, robot.model.createData()
    folders = [str(folder) for folder in robot.package_directories]
    shapes = pin.buildGeomFromUrdf(model, str(robot.path), pin.GeometryType.VISUAL, package_dirs=folders)
    pin.forwardKinematics(model, data, robot.full_position(position))
    heights = []
    for shape in shapes.geometryObjects:
        if shape.parentJoint == 0:
            continue
        shape.geometry.computeLocalAABB()
        box, pose = shape.geometry.aabb_local, data.oMi[shape.parentJoint] * shape.placement
        corners = np.array(np.meshgrid(*zip(box.min_, box.max_, strict=True))).reshape(3, -1)
        heights.append((pose.rotation @ corners)[2].min() + pose.translation[2])
    return min(heights)


@pytest.mark.parametrize("name", [*STANDING, *NAMED])
def test_home_is_inside_the_limits(name):
    robot = described(name)
    assert (robot.home >= robot.lower).all()
    assert (robot.home <= robot.upper).all()


@pytest.mark.parametrize("name", STANDING)
def test_the_arm_is_above_its_floor_at_home_and_on_its_way_to_near_home(name):
    """By the boxes around its links, which are larger than they are."""
    robot = described(name)
    way = robot.difference(robot.near_home(), robot.home)
    for share in np.linspace(0.0, 1.0, 9):
        assert lowest(robot, robot.home + share * way) > 0.0


@pytest.mark.parametrize("name", FULL_POSE)
def test_the_hand_is_not_in_a_singular_pose(name):
    system = MechanicalSystem(described(name))
    frame = system.robot.tool_frame or system.robot.frame_names[-1]
    jacobian = system.at(system.robot.home).frame_jacobian(frame, "local_world_aligned")
    assert np.linalg.svd(jacobian, compute_uv=False)[-1] > 0.1


def test_a_stretched_arm_would_be_seen():
    """Zero is where the UR5's own description leaves it: flat, and through the floor on its way."""
    system = MechanicalSystem(described("ur5"))
    assert lowest(system.robot, np.zeros(6)) < 0.0
    jacobian = system.at(np.zeros(6)).frame_jacobian("tool0", "local_world_aligned")
    assert np.linalg.svd(jacobian, compute_uv=False)[-1] < 1e-6


def test_an_angle_a_whole_turn_outside_its_limits_is_taken_inside():
    """The SRDF of the Kinova has −π/2 for a joint that goes from 0.33 to 5.95."""
    robot = load_robot("kinova")
    index = robot.joint_index("j2s6s200_joint_3")
    assert robot.home[index] == pytest.approx(1.5 * np.pi, abs=1e-2)
