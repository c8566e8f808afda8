"""Two models of an arm: what differs is found, and nothing else."""

from __future__ import annotations

import inspect
from dataclasses import fields, replace

import numpy as np
import pytest

from phcontrol import (
    ConstantTorque,
    InvalidArgumentError,
    MatrixDamping,
    MechanicalSystem,
    Payload,
    Pose,
    Robot,
    StopVelocity,
    StribeckFriction,
    compare_models,
    load_robot,
)
from phcontrol.analysis.model_comparison import SEEN_OTHERWISE


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


def test_the_coupling_of_a_full_damping_is_compared_too():
    """Only the diagonal was: drag of one joint on another was ignored."""
    robot = load_robot("pera_shoulder")
    first, second = (MechanicalSystem(robot, friction=MatrixDamping([[1.0, x], [x, 1.0]])) for x in (0.0, 0.5))
    found = compare_models(first, second).of("friction")
    assert [item.where for item in found] == list(robot.joint_names)
    assert abs(found[0].change) >= 1.0


STRIBECK = {"viscous": 0.1, "coulomb": [0.5, 0.0], "static": [0.8, 0.0], "stribeck_velocity": 0.1, "smoothing": 1e-3}


@pytest.mark.parametrize(
    ("change", "quantity", "joints"),
    [
        ({"stribeck_velocity": 0.2}, "Stribeck velocity of friction", 1),
        ({"smoothing": 1e-2}, "smoothing of friction", 1),
        ({"static": [0.9, 0.0]}, "static friction", 1),
        ({"viscous": 0.2}, "viscous friction", 2),
    ],
)
def test_every_parameter_of_friction_is_compared(change, quantity, joints):
    """Where it does something: where there is no dry friction its smoothing is nothing."""
    assert set(inspect.signature(StribeckFriction).parameters) == set(STRIBECK)
    robot = load_robot("pera_shoulder")
    first, second = (MechanicalSystem(robot, friction=StribeckFriction(**STRIBECK | more)) for more in ({}, change))
    report = compare_models(first, second, samples=3)
    assert {item.quantity for item in report.differences} == {quantity}
    assert len(report.differences) == joints


def other(value):
    """Return another value of the same kind."""
    if isinstance(value, np.ndarray):
        return ~value if value.dtype == bool else value + 0.1
    if isinstance(value, tuple):
        return tuple(not part for part in value)
    return StopVelocity(0.3, 6.0) if isinstance(value, StopVelocity) else "another"


def test_every_field_of_a_robot_is_compared_or_said_to_show_elsewhere():
    """A field that is added is compared as it stands; none is ignored."""
    robot = replace(load_robot("pera"), stop_velocity=StopVelocity(0.2, 6.0))
    names = {field.name for field in fields(Robot)}
    assert set(SEEN_OTHERWISE) < names
    for name in names - set(SEEN_OTHERWISE):
        changed = replace(robot, **{name: other(getattr(robot, name))})
        report = compare_models(robot, changed, samples=1)
        assert not report.same, name
    seen = compare_models(robot, replace(robot, tool_frame=None), samples=1)
    assert str(seen.differences[0]) == "tool frame: tool and none"
    assert seen.differences[0].change == np.inf
    seen = compare_models(robot, replace(robot, stop_velocity=None), samples=1)
    assert {item.quantity for item in seen.differences} == {"stop velocity offset", "stop velocity deceleration"}


def test_every_argument_of_a_system_is_compared():
    arguments = set(inspect.signature(MechanicalSystem).parameters) - {"robot"}
    robot = load_robot("pera_shoulder")
    turned = [[0.0, 1.0], [1.0, 0.0]]
    changes = {
        "friction": (None, {"viscous friction", "coulomb friction", "static friction"}),
        "potentials": ([ConstantTorque([0.0, 1.0])], {"gravity"}),
        "input_matrix": (turned, {"input matrix"}),
        "gravity": ((0.0, 0.0, -1.6), {"gravity", "gravity acceleration"}),
    }
    assert set(changes) == arguments
    for name, (value, expected) in changes.items():
        report = compare_models(robot, MechanicalSystem(robot, **{name: value}), samples=3)
        assert {item.quantity for item in report.differences} == expected, name
    varying = MechanicalSystem(robot, input_matrix=lambda q: np.diag([1.0, 1.0 + 0.1 * np.sin(q[0])]))
    report = compare_models(robot, varying)
    assert [item.where for item in report.differences] == [robot.joint_names[1]]
    assert 0.08 < report.largest("input matrix") < 0.1


def test_frames_are_compared():
    robot = load_robot("pera")
    moved = robot.with_frame("eye", "hand", Pose([0.0, 0.0, 0.05], np.eye(3)))
    assert [str(item) for item in compare_models(robot, moved, samples=1).differences] == [
        "frame of eye: missing and there"
    ]
    other_place = robot.with_frame("eye", "hand", Pose([0.0, 0.03, 0.01], np.eye(3)))
    (found,) = compare_models(moved, other_place, samples=2).differences
    assert (found.quantity, found.where) == ("frame position", "eye")
    assert found.change == pytest.approx(0.05)


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
