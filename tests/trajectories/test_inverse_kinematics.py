"""Inverse kinematics judged by forward kinematics, written again here on Pinocchio's bare calls."""

from __future__ import annotations

import sys

import numpy as np
import pink
import pink.exceptions
import pinocchio as pin
import pytest

from phcontrol import (
    InvalidArgumentError,
    MechanicalSystem,
    PHControlError,
    TrajectoryTracking,
    UnknownNameError,
    UnreachableTargetError,
    check_limits,
    follow,
    load_robot,
    reach,
    simulate,
)

FRAMES = {
    "pera": "tool",
    "ur5": "tool0",
    "kinova": "j2s6s200_link_6",  # continuous joints
    "panda": "panda_rightfinger",  # moved by a mimic joint
    "tiago_no_hand": "arm_7_link",  # a prismatic torso
}


BENT = np.array([-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2])  # the PERA, away from its limits


def forward(robot, frame, q):
    data = robot.model.createData()
    E = np.eye(robot.n) if robot.coupling is None else robot.coupling.matrix
    offset = 0.0 if robot.coupling is None else robot.coupling.offset
    pin.forwardKinematics(robot.model, data, E @ q + offset)
    return pin.updateFramePlacement(robot.model, data, robot.frame_id(frame))


@pytest.mark.parametrize("arm", list(FRAMES))
def test_reachable_poses_and_points_are_reached_inside_the_limits(arm):
    robot, frame, rng = load_robot(arm), FRAMES[arm], np.random.default_rng(7)
    for _ in range(4):
        desired = forward(robot, frame, robot.random_position(rng, margin=0.02))
        pose, point = reach(robot, frame, desired), reach(robot, frame, desired.translation)
        for posture in (pose, point):
            assert (posture.position >= robot.lower).all()
            assert (posture.position <= robot.upper).all()
            assert np.abs(forward(robot, frame, posture.position).translation - desired.translation).max() <= 1e-6
        turned = desired.rotation.T @ forward(robot, frame, pose.position).rotation
        assert np.arccos(min(1.0, 0.5 * (np.trace(turned) - 1.0))) <= 2e-6
        assert point.angle == 0.0


def test_a_matrix_is_a_pose_and_the_start_decides_which_of_two_solutions():
    robot = load_robot("ur5")
    elbow_up, elbow_down = np.array([0.3, -1.2, 1.5, -0.5, 0.7, 0.1]), np.array([0.3, 0.3, -1.4, 0.9, 0.7, 0.1])
    target = forward(robot, "tool0", elbow_up)
    near = reach(robot, "tool0", target.homogeneous, start=elbow_up + 0.05)
    np.testing.assert_allclose(near.position, elbow_up, atol=1e-5)
    other = reach(robot, "tool0", target, start=elbow_down)
    assert np.abs(other.position - elbow_up).max() > 0.5


def test_out_of_reach_says_how_near_it_came():
    robot = load_robot("pera")
    complaint = "frame 'tool' of pera does not reach its target: it stays"
    with pytest.raises(UnreachableTargetError, match=complaint) as caught:
        reach(robot, "tool", [5.0, 0.0, 1.0], restarts=1)
    nearest = caught.value.nearest
    assert nearest.distance > 4.0
    tip = forward(robot, "tool", nearest.position).translation
    assert np.linalg.norm(tip - [5.0, 0.0, 1.0]) == pytest.approx(nearest.distance)


def test_a_path_of_the_hand_is_followed_by_the_simulated_arm():
    """A circle of 5 cm: the hand passes every target; the arm under tracking keeps to it; joints never jump."""
    system = MechanicalSystem(load_robot("pera"))
    robot, times = system.robot, np.linspace(0.0, 6.0, 31)
    centre = forward(robot, "tool", BENT).translation
    angles = 2.0 * np.pi * times / times[-1]
    points = centre + 0.05 * np.column_stack([np.zeros(31), np.sin(angles), np.cos(angles) - 1.0])
    trajectory = follow(robot, "tool", list(points), times, start=BENT)
    for t, point in zip(times, points, strict=True):
        np.testing.assert_allclose(forward(robot, "tool", trajectory.at(t).position).translation, point, atol=2e-6)
    assert check_limits(trajectory, system).kept
    law = TrajectoryTracking(system, trajectory=trajectory, stiffness=60.0, damping=8.0)
    log = simulate(system, law, duration=6.0, dt=4e-3, q0=trajectory.at(0.0).position)
    hand = np.array([forward(robot, "tool", q).translation for q in log.position[::50]])
    radius = np.linalg.norm((hand - centre + [0.0, 0.0, 0.05])[:, 1:], axis=1)
    np.testing.assert_allclose(radius, 0.05, atol=5e-4)
    np.testing.assert_allclose(hand[:, 0], centre[0], atol=5e-4)


def test_a_path_too_fast_for_the_joints_is_refused():
    robot = load_robot("pera")
    home = forward(robot, "tool", BENT).translation
    above = np.add(home, [0.0, 0.0, 0.1])
    with pytest.raises(UnreachableTargetError, match="target number 1, within the velocity limits"):
        follow(robot, "tool", [home, above], [0.0, 0.05], start=BENT)


def matrix(rotation):
    pose = np.eye(4)
    pose[:3, :3] = rotation
    return pose


@pytest.mark.parametrize(
    ("arguments", "error", "complaint"),
    [
        (("hnad", [0.0, 0.0, 1.0]), UnknownNameError, "unknown frame 'hnad' of pera"),
        (("tool", [0.0, 1.0]), InvalidArgumentError, r"target: must be a point \(3,\)"),
        (("tool", 2.0 * np.eye(4)), InvalidArgumentError, "target: must have the last row"),
        (("tool", matrix(1.1 * np.eye(3))), InvalidArgumentError, "target: must be a point"),
        (("tool", matrix(np.eye(3) + 1e-5 * np.eye(3, k=1))), InvalidArgumentError, "target: must be a point"),
        (("tool", matrix(np.diag([1.0, 1.0, -1.0]))), InvalidArgumentError, "target: must be a point"),
        (("tool", [np.nan, 0.0, 0.0]), InvalidArgumentError, "target: must be finite"),
    ],
)
def test_bad_targets_are_refused(arguments, error, complaint):
    with pytest.raises(error, match=complaint):
        reach(load_robot("pera"), *arguments)


def test_bad_times_are_refused():
    robot = load_robot("pera")
    with pytest.raises(InvalidArgumentError, match="times: must be as many as targets"):
        follow(robot, "tool", [[0.0, 0.0, 1.0]], [0.0, 1.0])
    with pytest.raises(InvalidArgumentError, match="times: must be as many as targets"):
        follow(robot, "tool", [[0.0, 0.0, 1.0]] * 3, [0.0, 1.0])
    with pytest.raises(InvalidArgumentError, match="and at least 2"):
        follow(robot, "tool", [[0.0, 0.0, 1.0]], [0.0])
    for times in ([1.0, 0.0], [1.0, 1.0]):
        with pytest.raises(InvalidArgumentError, match="times: must increase"):
            follow(robot, "tool", [[0.0, 0.0, 1.0]] * 2, times)


@pytest.mark.parametrize("failure", ["no answer", "nonsense"])
def test_where_the_solver_fails_it_goes_on_from_elsewhere(monkeypatch, failure):
    robot = load_robot("pera")
    target = forward(robot, "tool", BENT).translation
    solve, calls = pink.solve_ik, []

    def solve_ik(configuration, *arguments, **keywords):
        calls.append(configuration.q.copy())
        if len(calls) > 1:
            return solve(configuration, *arguments, **keywords)
        if failure == "nonsense":
            return np.full(7, np.nan)
        raise pink.exceptions.PinkError

    monkeypatch.setattr(pink, "solve_ik", solve_ik)
    with pytest.raises(UnreachableTargetError) as caught:
        reach(robot, "tool", target, restarts=0)
    np.testing.assert_array_equal(caught.value.nearest.position, robot.home)
    assert len(calls) == 1
    calls.clear()
    found = reach(robot, "tool", target)
    assert np.abs(calls[1] - calls[0]).max() > 1e-3  # a random posture
    assert np.abs(forward(robot, "tool", found.position).translation - target).max() <= 1e-6


def test_without_pink_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pink", None)
    with pytest.raises(PHControlError, match=r"pip install 'phcontrol\[kinematics\]'"):
        reach(load_robot("pera"), "tool", [0.3, 0.0, 1.0])
