"""Robots: random positions, frozen fields, read-only arrays, joint kinds, friction of a file, inertia that is wrong."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from phcontrol import MechanicalSystem, RobotDescriptionError, load_robot
from phcontrol.mechanics.loading import DRY_FRICTION_SMOOTHING
from tests.conftest import make_system
from tests.mechanics.test_loading import INERTIAL, urdf


def chain(tmp_path, *joints, inertia=0.1, mass=1.0):
    """Write an arm of joints (type, limit, more) in a row."""
    parts = ['<robot name="chain"><link name="link0"/>']
    for k, (kind, limit, more) in enumerate(joints):
        parts.append(
            f'<link name="link{k + 1}">{INERTIAL.format(mass=mass, i=inertia)}</link>'
            f'<joint name="joint{k}" type="{kind}"><parent link="link{k}"/><child link="link{k + 1}"/>'
            f'<origin xyz="0 0.1 0.2"/><axis xyz="{(k + 1) % 2} {k % 2} 0"/>{limit}{more}</joint>'
        )
    path = tmp_path / "chain.urdf"
    path.write_text("".join(parts) + "</robot>")
    return path


def limits(low, high):
    return f'<limit lower="{low}" upper="{high}" effort="5" velocity="2"/>'


def test_random_positions_fill_the_limits_and_keep_the_margin(tmp_path):
    path = chain(
        tmp_path,
        ("revolute", limits(-0.5, 1.5), ""),
        ("continuous", limits(0, 0), ""),
        ("prismatic", limits(-9, 9), ""),
        ("prismatic", limits(0.1, 0.3), ""),
        ("revolute", limits(-10, 10), ""),
        ("revolute", limits(-math.pi, math.pi), ""),
        ("prismatic", limits(-0.1, 0.8), ""),
    )
    robot = load_robot(path)
    low = np.array([-0.5, -math.pi, -0.5, 0.1, -math.pi, -math.pi, -0.1])
    high = np.array([1.5, math.pi, 0.5, 0.3, math.pi, math.pi, 0.8])
    for margin in (0.0, 0.2):
        inner, outer = low + margin * (high - low), high - margin * (high - low)
        positions = np.array([robot.random_position(np.random.default_rng(k), margin) for k in range(400)])
        assert (positions >= inner).all()
        assert (positions <= outer).all()
        np.testing.assert_allclose(positions.min(axis=0), inner, atol=0.02 * 2 * math.pi)
        np.testing.assert_allclose(positions.max(axis=0), outer, atol=0.02 * 2 * math.pi)
    assert robot.prismatic == (False, False, True, True, False, False, True)
    assert robot.continuous.tolist() == [False, True, False, False, False, False, False]


def test_robots_are_frozen_and_their_arrays_read_only(pera):
    with pytest.raises(dataclasses.FrozenInstanceError):
        pera.robot.name = "other"
    coupling = make_system("panda_with_fingers").robot.coupling
    with pytest.raises(dataclasses.FrozenInstanceError):
        coupling.offset = 0
    for name in ("home", "lower", "upper", "velocity_limit", "effort_limit"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(pera.robot, name)[0] = 0.0


@pytest.mark.parametrize(
    ("dynamics", "viscous", "coulomb"),
    [('<dynamics damping="0.5"/>', 0.5, 0.0), ('<dynamics friction="0.3"/>', 0.0, 0.3), ("", None, None)],
)
def test_friction_of_one_joint_alone(tmp_path, dynamics, viscous, coulomb):
    """The other joint has no <dynamics>: no friction there."""
    path = chain(tmp_path, ("revolute", limits(-1, 1), dynamics), ("revolute", limits(-1, 1), ""))
    friction = load_robot(path).friction
    if viscous is None:
        assert friction is None
        return
    assert DRY_FRICTION_SMOOTHING == 1e-3
    speed = np.array([0.2, 0.2])
    expected = viscous + coulomb / math.sqrt(1e-3 + 0.04)
    np.testing.assert_allclose(friction.coefficients(speed), [expected, 0.0])


@pytest.mark.parametrize("case", ["mass", "moment", "none"])
def test_impossible_inertia_is_refused(tmp_path, case):
    arguments = {"mass": {"mass": -1.0}, "moment": {"inertia": -0.1}, "none": {"mass": 0.0, "inertia": 0.0}}[case]
    path = chain(tmp_path, ("revolute", limits(-1, 1), ""), ("revolute", limits(-1, 1), ""), **arguments)
    with pytest.raises(RobotDescriptionError, match=r"must not be negative|none may be negative|not positive definite"):
        load_robot(path)


def test_a_light_link_is_light_not_refused(tmp_path):
    robot = load_robot(chain(tmp_path, ("revolute", limits(-1, 1), ""), mass=1e-6, inertia=1e-9))
    assert 0.0 < MechanicalSystem(robot).at([0.0]).mass_matrix[0, 0] < 1e-5


def test_the_massless_joint_is_the_one_named(tmp_path):
    path = chain(tmp_path, ("revolute", limits(-1, 1), ""), ("revolute", limits(-1, 1), ""))
    text = path.read_text()
    last = text.rindex("<inertial>")
    path.write_text(text[:last] + text[text.index("</inertial>", last) + len("</inertial>") :])
    with pytest.raises(RobotDescriptionError, match="what moves with joint 'joint1' has no mass"):
        load_robot(path)


def test_home_of_a_locked_arm_keeps_the_free_joints(tmp_path):
    robot = load_robot("pera")
    locked = load_robot("pera", locked_joints=[robot.joint_names[0]])
    np.testing.assert_array_equal(locked.home, robot.home[1:])
    assert locked.joint_names == robot.joint_names[1:]
    assert load_robot(urdf(tmp_path)).locked_joints == {}


def test_velocities_given_as_lists_and_arrays_are_the_same_state(shoulder):
    a, b = shoulder.at([0.1, 0.2], [0.3, 0.4]), shoulder.at(np.array([0.1, 0.2]), np.array([0.3, 0.4]))
    np.testing.assert_array_equal(a.coriolis_matrix, b.coriolis_matrix)
    velocity = np.array([0.3, 0.4])
    x = shoulder.at(np.zeros(2), velocity)
    velocity[:] = 9.0
    np.testing.assert_array_equal(x.velocity, [0.3, 0.4])
