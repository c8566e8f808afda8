"""Two models of an arm: what differs is found, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phcontrol import (
    InvalidArgumentError,
    MatrixDamping,
    MechanicalSystem,
    Payload,
    StribeckFriction,
    compare_models,
    load_robot,
)


def test_a_model_is_the_same_as_itself():
    report = compare_models(load_robot("ur5"), load_robot("ur5"))
    assert report.same
    assert str(report) == "ur5 and ur5: no difference at 50 positions"


@pytest.mark.parametrize("arm", ["ur5", "panda"])
def test_rotors_are_found_on_the_diagonal_of_m(arm):
    plain = load_robot(arm, armature=0.0)
    name = plain.joint_names[2]
    report = compare_models(plain, load_robot(arm, armature={name: 0.3}))
    assert {item.quantity for item in report.differences} == {"armature", "M"}
    assert [item.where for item in report.of("M")] == [name]
    assert report.largest("M") == pytest.approx(0.3, abs=1e-12)
    assert report.largest("armature") == 0.3
    assert f"armature of {name}: 0 and 0.3 kg·m²" in str(report)


def test_weight_limits_and_friction_are_found():
    first = replace(load_robot("panda"), friction=None)
    second = load_robot("panda", payload=Payload(1.0, frame="panda_hand"))
    lower = np.array(first.lower)
    lower[1] = -1.0
    second = replace(second, lower=lower, friction=StribeckFriction(viscous=[0.0] * 6 + [0.4] + [0.0], coulomb=0.0))
    report = compare_models(first, second, samples=20)
    (limit,) = report.of("lower limit")
    assert (limit.where, limit.first, limit.second) == ("panda_joint2", first.lower[1], -1.0)
    assert report.largest("viscous friction") == 0.4
    heaviest = max(report.of("gravity"), key=lambda item: abs(item.change))
    assert heaviest.where in ("panda_joint2", "panda_joint4")
    assert 3.0 < abs(heaviest.change) < 12.0
    assert "panda_joint1" not in [item.where for item in report.of("gravity")]  # its axis is vertical


def test_a_full_damping_is_compared_by_what_it_does():
    robot = load_robot("pera_shoulder")
    system = MechanicalSystem(robot, friction=MatrixDamping(lambda q, v: 2.0 * np.eye(2)))
    report = compare_models(MechanicalSystem(robot, friction=None), system)
    assert [(item.where, item.change) for item in report.of("friction")] == [
        (name, pytest.approx(4.0)) for name in robot.joint_names
    ]


def test_joints_that_only_one_has_and_their_order():
    both, without = load_robot("panda"), load_robot("panda", locked_joints=["panda_joint4"])
    report = compare_models(both, without, samples=3)
    assert report.only_first == ("panda_joint4",)
    assert report.only_second == ()
    assert not report.same_order
    assert not report.of("gravity")  # the fourth stays at the home of each
    assert "joints that panda has not: panda_joint4" in str(report)
    turned = replace(without, joint_names=without.joint_names[::-1])
    assert not compare_models(without, turned, samples=1).same_order


def test_bad_input():
    with pytest.raises(InvalidArgumentError, match="second: must be a Robot or a MechanicalSystem, but is str"):
        compare_models(load_robot("ur5"), "ur5")
    with pytest.raises(InvalidArgumentError, match="second: shares no joint"):
        compare_models(load_robot("ur5"), load_robot("panda"))
