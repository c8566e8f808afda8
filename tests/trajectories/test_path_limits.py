"""Paths slowed to what the joints can do: checked by leading the arm along them with another integrator."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from phcontrol import (
    FigureOfEight,
    FrameArc,
    FrameLine,
    FrameSpline,
    InvalidArgumentError,
    UnknownNameError,
    UnreachableTargetError,
    within_limits,
)
from phcontrol.trajectories import path_limits
from phcontrol.trajectories.minimum_jerk import usual_speed
from tests.conftest import make_system

POSTURES = {
    "pera": ("tool", [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]),
    "panda": ("panda_hand", [0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.6]),
    "ur5": ("tool0", [0.3, -1.2, 1.5, -0.5, 0.7, 0.1]),
    "panda_with_fingers": ("panda_leftfinger", [0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.6, 0.02]),
}


def start_of(arm):
    system = make_system(arm)
    frame, q = POSTURES[arm]
    return system, frame, np.array(q), system.at(q).placement(frame)


def moved(pose, *way):
    return pin.SE3(pose.rotation, pose.translation + np.array(way))


def followed(path, system, q):
    """Times, positions, velocities, accelerations and errors of an arm led by the pseudoinverse, by SciPy's DOP853."""
    rows = len(path.at(0.0).twist)

    def velocity(t, q):
        jacobian = system.at(q).frame_jacobian(path.frame, "local_world_aligned")[:rows]
        return np.linalg.pinv(jacobian) @ path.at(t).twist

    times = np.linspace(0.0, path.duration, 1501)
    solution = solve_ivp(velocity, (0.0, path.duration), q, "DOP853", times, rtol=1e-9, atol=1e-11)
    speeds = np.array([velocity(t, p) for t, p in zip(times, solution.y.T, strict=True)])
    errors = []
    for t, p in zip(times[::100], solution.y.T[::100], strict=True):
        place, asked = system.at(p).placement(path.frame), path.at(t)
        errors.append(np.abs(place.translation - asked.position).max())
        if asked.rotation is not None:
            errors.append(np.abs(pin.log3(asked.rotation @ place.rotation.T)).max())
    return times, speeds, np.gradient(speeds, times, axis=0, edge_order=2), max(errors)


@pytest.mark.parametrize("arm", list(POSTURES))
def test_the_slowed_path_reaches_the_fraction_and_no_more(arm):
    system, frame, q, pose = start_of(arm)
    scale = {"panda_with_fingers": 0.1, "pera": 0.4}.get(arm, 1.0)  # the finger has 2 cm left, the elbow is bent little
    turn = pin.exp3(scale * np.array([0.2, -0.3, 0.4]))
    goal = moved(pin.SE3(turn @ pose.rotation, pose.translation), *(scale * np.array([0.05, -0.1, -0.08])))
    path = within_limits(FrameLine(frame, pose, goal, 0.05), system, q, fraction=0.4)
    _, speeds, _, error = followed(path, system, q)
    assert (np.abs(speeds) / usual_speed(system.robot)).max() == pytest.approx(0.4, rel=1e-3)
    assert path.factor > 1.0
    assert error < 1e-6


def test_accelerations_are_kept_when_they_are_limited():
    system, frame, q, pose = start_of("panda")
    eight = FigureOfEight(frame, pose, 0.2, 0.1, 1.0, turn=0.3)
    path = within_limits(eight, system, q, acceleration_limit=4.0, fraction=0.5)
    _, speeds, accelerations, _ = followed(path, system, q)
    assert np.abs(accelerations).max() == pytest.approx(2.0, rel=1e-3)
    assert (np.abs(speeds) / usual_speed(system.robot)).max() < 0.5
    per_joint = within_limits(eight, system, q, acceleration_limit=[4.0] * 6 + [400.0])
    assert 1.0 < per_joint.factor <= path.factor


def test_a_path_that_is_slow_enough_stays_as_it_is():
    system, frame, q, pose = start_of("ur5")
    line = FrameLine(frame, pose, moved(pose, 0.0, 0.0, 0.05), 5.0)
    assert within_limits(line, system, q).factor == 1.0


def test_the_factor_does_not_depend_on_how_fast_the_path_is_given():
    system, frame, q, pose = start_of("pera")
    arcs = [FrameArc(frame, pose, moved(pose, 0.0, 0.0, 0.05).translation, [1, 0, 0], 3.0, T) for T in (0.1, 0.2)]
    durations = [within_limits(arc, system, q).duration for arc in arcs]
    assert durations[0] == pytest.approx(durations[1], rel=1e-6)


def test_positions_alone_for_an_arm_of_few_joints():
    system = make_system("pera_shoulder_elbow")
    q = system.robot.near_home()
    point = system.at(q).placement("tool").translation
    points = point + np.array([[0.0, 0.0, 0.0], [0.02, 0.01, 0.02], [0.0, 0.03, 0.0]])
    path = within_limits(FrameSpline("tool", points, 0.05), system, q)
    _, speeds, _, error = followed(path, system, q)
    assert (np.abs(speeds) / usual_speed(system.robot)).max() == pytest.approx(0.5, rel=1e-3)
    assert error < 1e-6


def test_a_redundant_arm_goes_the_way_that_the_pseudoinverse_leads():
    """Few samples, so that steps are long: where they lead is seen against another integrator at the same times."""
    system, frame, q, pose = start_of("panda")
    line = FrameLine(frame, pose, moved(pose, -0.2, 0.2, -0.15), 0.05)
    _, speeds, _, _ = followed(line, system, q)
    fastest = np.abs(speeds[::75] / usual_speed(system.robot)).max()
    assert within_limits(line, system, q, samples=21).factor == pytest.approx(fastest / 0.5, rel=1e-6)


def test_what_the_arm_cannot_follow_is_refused(monkeypatch):
    system, frame, q, pose = start_of("ur5")
    far = FrameLine(frame, pose, moved(pose, 2.0, 0.0, 0.0), 1.0)
    with pytest.raises(
        InvalidArgumentError, match=r"path: leads frame 'tool0' of ur5 too near a singularity.*at 0\.\d+ s"
    ):
        within_limits(far, system, q)
    near = FrameLine(frame, pose, moved(pose, 0.0, 0.0, 0.01), 1.0)
    with pytest.raises(InvalidArgumentError, match="below singular_region = 0.5"):
        within_limits(near, system, q, singular_region=0.5)
    arm, tool, posture, place = start_of("pera")
    fingers, finger, opened, tip = start_of("panda_with_fingers")
    with pytest.raises(
        InvalidArgumentError, match=r"path: takes joint 'panda_finger_joint1' to -0.0002.* beyond its limit 0$"
    ):
        within_limits(FrameLine(finger, tip, moved(tip, 0.05, 0.1, -0.08), 1.0), fingers, opened)
    beyond = posture.copy()
    beyond[1] = arm.robot.upper[1] + 0.1
    with pytest.raises(
        InvalidArgumentError, match=r"path: takes joint 'shoulder_pitch' to .* at 0 s, beyond its limit"
    ):
        within_limits(FrameLine(tool, arm.at(beyond).placement(tool), place, 1.0), arm, beyond)
    monkeypatch.setattr(path_limits, "_CORRECTIONS", 1)
    complaint = r"'tool0' of ur5 does not reach its target at .* s of the path"
    with pytest.raises(UnreachableTargetError, match=complaint) as caught:
        within_limits(near, system, q + 1e-5)
    posture = caught.value.nearest
    there = system.at(posture.position).placement(frame)
    assert posture.distance == pytest.approx(np.linalg.norm(there.translation - pose.translation), rel=1e-4)
    assert posture.angle == pytest.approx(np.linalg.norm(pin.log3(there.rotation.T @ pose.rotation)), rel=1e-4)


@pytest.mark.parametrize(
    ("arguments", "error", "complaint"),
    [
        (
            {"start": np.zeros(6)},
            InvalidArgumentError,
            r"start: puts frame 'tool0' .* m and .* rad from where the path",
        ),
        ({"start": np.zeros(5)}, InvalidArgumentError, r"start: must have shape \(6,\)"),
        ({"fraction": 0.0}, InvalidArgumentError, "fraction: must be > 0"),
        ({"acceleration_limit": 0.0}, InvalidArgumentError, "acceleration_limit: must be > 0"),
        ({"acceleration_limit": [1.0, 2.0]}, InvalidArgumentError, r"acceleration_limit: must have shape \(6,\)"),
        ({"samples": 1}, InvalidArgumentError, "samples: must be an integer >= 2"),
        ({"singular_region": -1.0}, InvalidArgumentError, "singular_region: must be > 0"),
        ({"path": "fast"}, InvalidArgumentError, "path: must be the path of a frame"),
        ({"path": FrameLine("tolo0", [0, 0, 0], [1, 0, 0], 1.0)}, UnknownNameError, "unknown frame 'tolo0' of ur5"),
    ],
)
def test_bad_arguments_are_refused(arguments, error, complaint):
    system, frame, q, pose = start_of("ur5")
    good = {"path": FrameLine(frame, pose, moved(pose, 0.0, 0.0, 0.01), 1.0), "system": system, "start": q}
    with pytest.raises(error, match=complaint):
        within_limits(**{**good, **arguments})
