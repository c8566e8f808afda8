"""Rendered images, and what is found in them, against the features that are known."""

from __future__ import annotations

import builtins

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phcontrol import InvalidArgumentError, ObservedObject, PHControlError, PinholeCamera, Renderer, extract_features
from phcontrol.vision.rendered_view import RenderedView
from tests.conftest import make_system

CAMERA = PinholeCamera(image_size=(640, 480), field_of_view=np.deg2rad(60.0)).mounted_on(make_system("pera").robot)


def scene_and_pose(pixels, turn=0.0):
    """An object that faces the camera and is seen at (column, row, length) in pixels."""
    system = make_system("pera")
    x = system.at(system.robot.home)
    scene = ObservedObject.seen_as(CAMERA, CAMERA.from_pixels(pixels), x, turn=turn)
    return scene, x.placement(CAMERA.frame)


@settings(max_examples=25)
@given(st.floats(150, 490), st.floats(150, 330), st.floats(45, 250), st.floats(-1.5, 1.5))
def test_what_is_drawn_is_found_below_a_pixel(column, row, length, turn):
    scene, pose = scene_and_pose([column, row, length], turn)
    found = extract_features(Renderer(scene).render(pose), CAMERA)
    error = CAMERA.to_pixels(found) - [column, row, length]
    assert np.abs(error[:2]).max() < 0.25
    # the variance of the lens's blur adds, √(l² + 12) − l; the fine pixels of the drawing the rest
    assert abs(error[2]) < 12.0 / (2.0 * length) + 0.5


def test_noise_averages_out():
    scene, pose = scene_and_pose([300.0, 250.0, 110.0], 0.4)
    view = RenderedView(Renderer(scene, corner_noise=1.0, grey_noise=5.0))
    generator = np.random.default_rng(0)
    errors = np.array([CAMERA.to_pixels(view(pose, generator)) for _ in range(40)]) - [300.0, 250.0, 110.0]
    spread = errors.std(axis=0)
    # four corners of one pixel each: half a pixel at least for their mean, and seen with both ends for the length
    assert (spread > 0.3).all()
    assert (spread < 2.0).all()
    assert np.abs(errors.mean(axis=0)).max() < 1.0


def test_same_seed_same_image():
    scene, pose = scene_and_pose([300.0, 250.0, 110.0])
    renderer = Renderer(scene, corner_noise=1.0, grey_noise=5.0)
    first, again, other = (renderer.render(pose, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


@pytest.mark.parametrize(
    "pixels",
    [[-10.0, 240.0, 100.0], [20.0, 240.0, 100.0], [320.0, 478.0, 100.0], [1200.0, 240.0, 100.0], [320, 240, 3]],
)
def test_an_object_that_is_not_wholly_seen_is_not_found(pixels):
    scene, pose = scene_and_pose(pixels)
    assert extract_features(Renderer(scene).render(pose), CAMERA) is None


def test_an_object_behind_the_camera_is_not_drawn():
    scene, pose = scene_and_pose([320.0, 240.0, 100.0])
    behind = ObservedObject(CAMERA, pose.act(np.array([0.0, 0.0, -0.2])))
    image = Renderer(behind).render(pose)
    assert (image == Renderer(behind)._ground).mean() > 0.99
    assert extract_features(image, CAMERA) is None


def test_the_largest_orange_spot_is_the_object():
    scene, pose = scene_and_pose([300.0, 250.0, 110.0])
    image = Renderer(scene).render(pose)
    image[20:30, 20:30] = (20, 110, 240)
    image[400:420, 500:560] = (200, 60, 20)  # blue
    np.testing.assert_allclose(CAMERA.to_pixels(extract_features(image, CAMERA))[:2], [300.0, 250.0], atol=0.5)


def test_a_camera_without_pixels_makes_no_images():
    with pytest.raises(InvalidArgumentError, match="scene: its camera has no pixels"):
        Renderer(ObservedObject(PinholeCamera(), [0.0, 0.0, 0.0]))


def test_without_opencv_the_error_says_what_to_install(monkeypatch):
    scene, _ = scene_and_pose([300.0, 250.0, 110.0])
    real = builtins.__import__

    def without(name, *arguments, **keywords):
        if name == "cv2":
            raise ImportError(name)
        return real(name, *arguments, **keywords)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(PHControlError, match=r"pip install 'phcontrol\[vision\]'"):
        Renderer(scene)
