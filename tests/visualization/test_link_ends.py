"""The last link of an arm without meshes is drawn, too, on pages and in plots."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import load_robot
from phcontrol.visualization.drawn_arm import DrawnArm
from phcontrol.visualization.link_ends import link_end
from phcontrol.visualization.plots import skeleton


def arm(tmp_path, tip=""):
    link = (
        '<link name="{0}"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>'
        '<inertia ixx="0.02" iyy="0.02" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j{0}" type="revolute"><parent link="{1}"/><child link="{0}"/><origin xyz="0 0 0.3"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="60" velocity="3"/></joint>'
    )
    path = tmp_path / "bare.urdf"
    text = link.format("a", "base") + link.format("b", "a")
    path.write_text(f'<robot name="bare"><link name="base"/>{text}{tip}</robot>')
    return load_robot(path)


TIP = (
    '<link name="tip"/><joint name="f" type="fixed"><parent link="b"/><child link="tip"/>'
    '<origin xyz="0 0 0.25"/></joint>'
)


@pytest.mark.parametrize(("tip", "height"), [("", 0.8), (TIP, 0.85)])  # twice the centre of mass; the frame on it
def test_the_last_link_is_drawn(tmp_path, tip, height):
    robot = arm(tmp_path, tip)
    np.testing.assert_allclose(skeleton(robot, np.zeros(2))[:, 2], [0.0, 0.3, 0.6, height], atol=1e-12)
    drawn = DrawnArm(robot)
    lines = [shape for shape in drawn.link_shapes["b"] if shape.kind == "lines"]
    np.testing.assert_allclose(lines[0].points, [[0.0, 0.0, 0.0], [0.0, 0.0, height - 0.6]], atol=1e-12)


def test_a_link_on_which_another_hangs_ends_there(tmp_path):
    robot = arm(tmp_path)
    assert link_end(robot.model, 1) is None
    np.testing.assert_allclose(link_end(robot.model, 2), [0.0, 0.0, 0.2], atol=1e-12)


def test_a_tool_frame_is_the_end_of_an_arm_that_names_one():
    robot = load_robot("pera")
    end = skeleton(robot, robot.home)[-1]
    np.testing.assert_allclose(end, robot.placement("tool", robot.home).translation, atol=1e-12)
