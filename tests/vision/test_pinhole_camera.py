"""The camera: pixels, its field of view, where it is mounted, and what it says about an object it does not see."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import InvalidArgumentError, MechanicalSystem, UnknownNameError, load_robot
from phcontrol.vision.pinhole_camera import PinholeCamera, camera_frame
from tests.conftest import make_system

CAMERA = PinholeCamera(image_size=(640, 480), field_of_view=np.deg2rad(60.0))


@given(st.floats(-0.005, 0.005), st.floats(-0.004, 0.004), st.floats(1e-4, 0.01))
def test_pixels_and_back(mu, nu, size):
    features = np.array([mu, nu, size])
    np.testing.assert_allclose(CAMERA.from_pixels(CAMERA.to_pixels(features)), features, atol=1e-15)


def test_the_image_spans_the_field_of_view():
    edge = CAMERA.focal_length * np.tan(np.deg2rad(30.0))
    np.testing.assert_allclose(CAMERA.to_pixels([edge, 0.75 * edge, 0.0])[:2], [639.5, 479.5])
    np.testing.assert_allclose(CAMERA.to_pixels([0.0, 0.0, 2.0 * edge]), [319.5, 239.5, 640.0])
    assert CAMERA.half_size == pytest.approx((edge, 0.75 * edge))


@pytest.mark.parametrize(
    ("features", "why"),
    [
        ([0.0, 0.0, 2e-3], ""),
        ([0.0, 0.0, 0.0], "not in front of the camera"),
        ([0.0, 0.0, -1e-3], "Z <= 0"),
        ([0.0, 0.0, np.inf], "not in front of the camera"),
        ([np.nan, 0.0, 2e-3], "no object is found"),
        ([6e-3, 0.0, 2e-3], "left the image"),
        ([0.0, -5e-3, 2e-3], "left the image"),
    ],
)
def test_what_is_seen_and_why_not(features, why):
    features = np.array(features)
    assert CAMERA.sees(features) is (why == "")
    assert why in CAMERA.why_not_seen(features)
    assert (CAMERA.why_not_seen(features) == "") is CAMERA.sees(features)


def test_a_camera_without_bounds_sees_sideways():
    assert PinholeCamera().sees(np.array([0.038, 0.0072, 0.010]))  # 75° off the axis, as the thesis starts


def test_without_an_image_as_much_is_seen_above_as_below():
    camera = PinholeCamera(field_of_view=1.0, pixel_aspect=1.25, focal_length=0.01)
    assert camera.bounds.right == -camera.bounds.left == pytest.approx(0.01 * np.tan(0.5))
    assert camera.bounds.bottom == -camera.bounds.top == pytest.approx(0.01 * np.tan(0.5) / 1.25)


def test_where_it_is_mounted():
    assert camera_frame(make_system("pera").robot) == "camera"
    assert camera_frame(make_system("pera_shoulder").robot) == "tool"
    ur5 = make_system("ur5").robot
    moved_by = ur5.model.supports[ur5.model.frames[ur5.frame_id(camera_frame(ur5))].parentJoint]
    assert len(moved_by) == 7  # the world and all six joints
    assert PinholeCamera().mounted_on(make_system("pera").robot).frame == "camera"
    assert PinholeCamera(frame="tool").mounted_on(make_system("pera").robot).frame == "tool"
    assert PinholeCamera(frame="tool").mounted_on(make_system("pera").robot, "hand").frame == "hand"
    with pytest.raises(UnknownNameError, match="unknown frame 'eye' of pera"):
        PinholeCamera(frame="eye").mounted_on(make_system("pera").robot)


def test_the_thesis_mounting():
    """Camera axes x, y, z along y3, z3, x3 of DH frame 3, which is the tool frame."""
    robot = load_robot("pera_shoulder_elbow")
    x = MechanicalSystem(robot).at([0.3, -0.4, 1.1])
    tool, camera = x.placement("tool"), x.placement("camera")
    np.testing.assert_allclose(camera.translation, tool.translation, atol=1e-12)
    np.testing.assert_allclose(camera.rotation, tool.rotation[:, [1, 2, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"focal_length": 0.0}, "focal_length: must be > 0"),
        ({"field_of_view": 4.0}, "field_of_view: must be <= 3.14059"),
        ({"field_of_view": 3.141}, "field_of_view: must be <="),
        ({"field_of_view": 0.0}, "field_of_view: must be > 0"),
        ({"image_size": (7, 480), "field_of_view": 1.0}, "image_size: must be an integer >= 8"),
        ({"image_size": (640, 7), "field_of_view": 1.0}, "image_size: must be an integer >= 8"),
        ({"image_size": (640, 480)}, "field_of_view: is needed"),
        ({"image_size": (640, 4.5), "field_of_view": 1.0}, "image_size: must be an integer"),
        ({"image_size": (640,), "field_of_view": 1.0}, "image_size: must be"),
    ],
)
def test_bad_cameras_are_refused(arguments, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        PinholeCamera(**arguments)


def test_the_smallest_and_the_widest_images():
    assert PinholeCamera(image_size=(8, 8), field_of_view=1e-3).image_size == (8, 8)
    assert PinholeCamera(field_of_view=np.pi - 2e-3).half_size[0] == pytest.approx(0.01 / np.tan(1e-3))


def test_what_a_viewer_is_told():
    half = CAMERA.focal_length * np.tan(np.deg2rad(30.0))
    record = CAMERA.record()
    assert record == {
        "frame": None,
        "focal_length": 0.01,
        "half_size": [pytest.approx(half), pytest.approx(0.75 * half)],
    }
    assert PinholeCamera(frame="tool").record() == {"frame": "tool", "focal_length": 0.01, "half_size": [None, None]}


def test_the_edge_of_the_image_is_in_it():
    half_width, half_height = CAMERA.half_size
    for sign in (-1.0, 1.0):
        assert CAMERA.sees(np.array([sign * half_width, -sign * half_height, 1e-3]))
        assert not CAMERA.sees(np.array([sign * half_width * 1.001, 0.0, 1e-3]))
        assert not CAMERA.sees(np.array([0.0, sign * half_height * 1.001, 1e-3]))


def test_a_camera_without_image_has_no_pixels():
    with pytest.raises(InvalidArgumentError, match="image_size: this camera has no pixels"):
        PinholeCamera().to_pixels([0.0, 0.0, 1e-3])
