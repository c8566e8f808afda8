"""Objects in space, features as a differential equation, and the posture at the goal."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import HamiltonianServo, InvalidArgumentError, Log, PHControlError, make_controller, simulate
from phcontrol.vision.feature_flow import FeatureFlow
from phcontrol.vision.goal_posture import goal_posture
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera
from tests.conftest import make_system
from tests.finite_differences import derivative

START, GOAL = np.array([0.038, 0.0072, 0.010]), np.array([0.0, 0.0, 0.002])


def test_features_that_flow_are_those_of_an_object_at_rest():
    """τ̇ = Δ̄q̇ integrated along a run, against the projection of the point, whose features need no integration."""
    system = make_system("pera_shoulder_elbow")
    law = HamiltonianServo(system, goal=GOAL, rate=2.0, stiffness=1e3, damping=5.0)
    flow = FeatureFlow(law.camera, START, law.object_length)
    scene = ObservedObject.seen_as(law.camera, START, system.at(system.robot.home))
    flowing = simulate(system, law, duration=1.0, scene=flow)
    resting = simulate(system, law, duration=1.0, scene=scene)
    np.testing.assert_allclose(flowing.features, resting.features, atol=1e-9)
    np.testing.assert_allclose(flowing.position, resting.position, atol=1e-8)
    np.testing.assert_allclose(flowing.body_state, flowing.features)
    assert resting.body_state.shape[1] == 0


@pytest.mark.parametrize("arm", ["pera_shoulder_elbow", "pera", "panda", "ur5"])
def test_the_goal_posture_looks_as_desired(arm, rng):
    system = make_system(arm)
    camera = PinholeCamera().mounted_on(system.robot)
    for _ in range(5):
        position = system.robot.random_position(rng, 0.2)
        scene = ObservedObject.seen_as(camera, GOAL, system.at(position))
        guess = position + rng.uniform(-0.2, 0.2, size=system.n)
        found = goal_posture(system, scene, GOAL, guess)
        np.testing.assert_allclose(scene.features(system.at(found)), GOAL, atol=1e-9)


def test_an_object_out_of_reach_has_no_goal_posture():
    system = make_system("pera_shoulder_elbow")
    scene = ObservedObject(PinholeCamera(), [5.0, 0.0, 0.0])
    with pytest.raises(PHControlError, match="no posture found"):
        goal_posture(system, scene, GOAL, steps=50)


def test_an_object_that_faces_the_camera_is_turned_in_the_image():
    system = make_system("pera")
    x = system.at(system.robot.home)
    scene = ObservedObject.seen_as(PinholeCamera(), GOAL, x, turn=0.3)
    facing = ObservedObject.seen_as(PinholeCamera(), GOAL, x)
    np.testing.assert_allclose(facing.rotation, x.placement("camera").rotation, atol=1e-12)
    length_axis = x.placement("camera").rotation.T @ scene.rotation[:, 0]
    np.testing.assert_allclose(length_axis, [np.cos(0.3), np.sin(0.3), 0.0], atol=1e-12)


def test_features_flow_as_they_are_seen_to_move(rng):
    """Its rate is the derivative of an object's features, for cameras in a named frame and in the robot's own."""
    system = make_system("pera")
    for camera in (PinholeCamera(), PinholeCamera(0.02, frame="hand")):
        x = system.at(system.robot.random_position(rng), rng.normal(size=7))
        scene = ObservedObject.seen_as(camera, START, x, size=(0.05, 0.01, 0.01))
        moved = derivative(lambda h, x=x, scene=scene: scene.features(system.at(x.position + h * x.velocity)), 1e-4)
        rate = FeatureFlow(camera, START, 0.05).rate(x, START)
        np.testing.assert_allclose(rate, moved, atol=1e-9 * np.abs(moved).max())


def test_an_object_is_recorded_as_it_stands():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    scene = ObservedObject(PinholeCamera(), [0.1, 0.2, 0.3], [0.05, 0.02, 0.01], turn)
    assert scene.record() == {"position": [0.1, 0.2, 0.3], "rotation": turn.tolist(), "size": [0.05, 0.02, 0.01]}
    assert ObservedObject(PinholeCamera(), [0.0, 0.0, 0.0]).record()["rotation"] == np.eye(3).tolist()
    assert scene.state_size == len(scene.initial_state()) == 0
    seen = ObservedObject.seen_as(PinholeCamera(), GOAL, make_system("pera").at(make_system("pera").robot.home))
    for usual in (ObservedObject(PinholeCamera(), [0.0, 0.0, 0.0]), seen):
        assert usual.record()["size"] == [0.038, 0.0072, 0.010]


@pytest.mark.parametrize("size", [[0.0, 0.01, 0.01], [0.04, -0.01, 0.01], [0.04, 0.01, 0.0]])
def test_an_object_without_size_is_refused(size):
    with pytest.raises(InvalidArgumentError, match="size: must be > 0"):
        ObservedObject(PinholeCamera(), [0.0, 0.0, 0.0], size)


def test_the_goal_posture_is_found_by_small_steps():
    """No step is longer than 0.2 rad; where they are too few that is said."""
    system = make_system("pera_shoulder_elbow")
    goal, guess = system.robot.home, np.add(system.robot.home, [0.3, 0.3, -0.3])
    scene = ObservedObject.seen_as(PinholeCamera(), GOAL, system.at(goal))
    with pytest.raises(PHControlError, match="no posture found"):
        goal_posture(system, scene, GOAL, guess, steps=2)  # 0.3 rad at 0.2 a step, and one to see that it is there
    found = goal_posture(system, scene, GOAL, guess)
    np.testing.assert_allclose(scene.features(system.at(found)), GOAL, atol=1e-9)
    there = goal_posture(system, scene, GOAL, goal, steps=1)
    np.testing.assert_array_equal(there, goal)


def test_servo_laws_ask_for_something_to_see():
    system = make_system("pera")
    with pytest.raises(ValueError, match=r"scene: hamiltonian_servo needs image features.*scene=ObservedObject"):
        simulate(system, make_controller("hamiltonian_servo", system), duration=0.1)


def test_features_are_kept_in_files_and_tables(tmp_path):
    system = make_system("pera_shoulder_elbow")
    law = make_controller("hamiltonian_servo", system)
    scene = FeatureFlow(law.camera, [0.001, 0.002, 0.003], law.object_length)
    log = simulate(system, law, duration=0.02, scene=scene)
    loaded = Log.load(log.save(tmp_path / "log.npz"))
    np.testing.assert_array_equal(loaded.features, log.features)
    np.testing.assert_array_equal(loaded.body_state, log.body_state)
    np.testing.assert_array_equal(log.to_dataframe()["features/nu"], log.features[:, 1])


def test_a_run_without_scene_has_no_features():
    system = make_system("pera_shoulder")
    log = simulate(system, make_controller("energy_shaping", system), duration=0.01)
    with pytest.raises(PHControlError, match="no image features"):
        _ = log.features


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (2.0 * np.eye(3), "must be a rotation matrix"),
        (np.zeros((3, 3)), "must be a rotation matrix"),
        (np.diag([1.0, 1.0, -1.0]), "must be a rotation matrix"),
        (np.eye(2), "must be a rotation matrix of shape"),
        (np.full((3, 3), np.nan), "must be finite"),
        ("turned", "must be an array"),
    ],
)
def test_an_object_turned_by_no_rotation_is_refused(rotation, message):
    with pytest.raises(InvalidArgumentError, match=f"rotation: {message}"):
        ObservedObject(PinholeCamera(), [0.0, 0.0, 0.5], rotation=rotation)


def test_the_rotation_of_an_object_is_a_copy():
    given = np.eye(3)
    scene = ObservedObject(PinholeCamera(), [0.0, 0.0, 0.5], rotation=given)
    given[0, 0] = 5.0
    np.testing.assert_array_equal(scene.rotation, np.eye(3))


def test_an_object_is_not_seen_without_a_length():
    arm = make_system("pera")
    with pytest.raises(InvalidArgumentError, match="features: must have a length l other than 0"):
        ObservedObject.seen_as(PinholeCamera(), [1e-3, 2e-3, 0.0], arm.at(arm.robot.home))
    with pytest.raises(InvalidArgumentError, match="turn: must be finite"):
        ObservedObject.seen_as(PinholeCamera(), [1e-3, 2e-3, 2e-3], arm.at(arm.robot.home), turn=np.nan)
