"""Fingers close on what is between them, and on nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import CompliantBody, GraspContact, InvalidArgumentError, JointContact
from tests.conftest import make_system

SYSTEM = make_system("pera_with_gripper")
HOME = np.array(SYSTEM.robot.home)
TOOL = SYSTEM.robot.placement("tool", HOME).translation


def at(gripper):
    return SYSTEM.at(np.append(HOME[:-1], gripper))


@pytest.mark.parametrize("gripper", [0.9, 0.41, 0.39, 0.2])
def test_between_the_fingers_it_is_a_body_in_the_way_of_the_joint(gripper):
    contact = GraspContact("gripper", 0.4, TOOL + np.array([0.0, 0.004, -0.004]), "tool", reach=0.006)
    gap, plain = contact.gap(at(gripper)), JointContact("gripper", 0.4).gap(at(gripper))
    assert gap.distance == plain.distance
    np.testing.assert_array_equal(gap.slope, plain.slope)


@pytest.mark.parametrize("away", [[0.0, 0.0, 0.0061], [0.05, 0.0, 0.0], [-1.0, 2.0, 0.0]])
def test_elsewhere_the_fingers_miss_it(away):
    contact = GraspContact("gripper", 0.4, TOOL + away, "tool", reach=0.006)
    foam = CompliantBody(contact, stiffness=8.0, damping=0.2, mass=0.01)
    touch = foam.touch(at(0.1), foam.initial_state())
    assert touch.magnitude == 0.0
    assert (touch.force == 0.0).all()
    near = GraspContact("gripper", 0.4, TOOL, "tool", reach=0.006)
    assert CompliantBody(near, stiffness=8.0, damping=0.2, mass=0.01).touch(at(0.1), np.zeros(2)).magnitude > 1.0


@pytest.mark.parametrize(
    "wrong", [{"reach": 0.0}, {"centre": [0.0, 1.0]}, {"centre": [np.nan] * 3}, {"frame": ""}, {"side": "left"}]
)
def test_what_makes_no_sense_is_refused(wrong):
    with pytest.raises((InvalidArgumentError, LookupError)):
        GraspContact(**({"joint": "gripper", "position": 0.4, "centre": TOOL, "frame": "tool"} | wrong))
