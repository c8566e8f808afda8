"""Features and their interaction matrix, against moving the arm and against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol.vision.interaction import (
    back_project,
    interaction_matrix,
    interaction_matrix_derivative,
    interaction_matrix_rate,
    project,
)
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera
from tests.conftest import make_system
from tests.finite_differences import gradient

F, L = 0.01, 0.038
SERVO_ARMS = ("pera_shoulder_elbow", "pera", "panda", "kinova", "panda_with_fingers")
coordinate = st.floats(-0.3, 0.3)


def relative(actual, expected):
    """Largest difference over the largest entry: image quantities are much smaller than one."""
    return float(np.abs(actual - expected).max() / np.abs(expected).max())


features_in_view = st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(5e-4, 0.02)).map(np.array)


@given(coordinate, coordinate, st.floats(0.02, 2.0))
def test_a_point_projects_by_similar_triangles_and_back(x, y, z):
    point = np.array([x, y, z])
    features = project(point, F, L)
    np.testing.assert_allclose(features * z, F * np.array([x, y, L]), atol=1e-15)
    np.testing.assert_allclose(back_project(features, F, L), point, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("arm", SERVO_ARMS)
def test_features_move_as_the_interaction_matrix_says(arm, rng):
    """τ̇ = Δ(τ)𝒥q̇ with the twist in the camera's own frame, for an object at rest in the world."""
    system = make_system(arm)
    camera = PinholeCamera(focal_length=F).mounted_on(system.robot)
    for _ in range(5):
        q, v = system.robot.random_position(rng), rng.normal(size=system.n)
        features = np.array([*rng.uniform(-0.006, 0.006, size=2), rng.uniform(1e-3, 5e-3)])
        scene = ObservedObject.seen_as(camera, features, system.at(q))
        np.testing.assert_allclose(scene.features(system.at(q)), features, rtol=1e-12)
        x = system.at(q, v)
        image_jacobian = interaction_matrix(features, F, L) @ x.frame_jacobian(camera.frame, "local")
        moved = gradient(lambda p, scene=scene: scene.features(system.at(p)), q, 2e-4).T
        assert relative(image_jacobian, moved) < 1e-9


def test_the_printed_interaction_matrix_does_not_fit_the_moving_arm(rng):
    """Errata E17: with −l²/(fL) an object seems to shrink when the camera comes nearer."""
    printed = interaction_matrix(np.array([0.0, 0.0, 2e-3]), F, L)
    printed[2, 2] *= -1.0
    nearer, farther = project(np.array([0.0, 0.0, 0.19 - 1e-6]), F, L), project(np.array([0.0, 0.0, 0.19]), F, L)
    true = (nearer - farther)[2] / 1e-6  # the camera moves along its axis by a micrometre
    assert true > 0.0 > printed[2, 2]
    assert interaction_matrix(np.array([0.0, 0.0, 2e-3]), F, L)[2, 2] == pytest.approx(true, rel=1e-4)


@given(features_in_view)
def test_the_derivative_of_the_interaction_matrix(features):
    analytic = interaction_matrix_derivative(features, F, L).reshape(3, 18)
    assert relative(analytic, gradient(lambda t: interaction_matrix(t, F, L).ravel(), features, 1e-4)) < 1e-9
    rate = np.array([0.01, -0.02, 0.003])
    np.testing.assert_allclose(
        interaction_matrix_rate(features, rate, F, L).ravel(), rate @ analytic, rtol=1e-12, atol=1e-15
    )
