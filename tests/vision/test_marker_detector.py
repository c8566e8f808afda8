"""Markers: poses that are known, images that are made ray by ray with OpenCV's own lens."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import ColourDetector, InvalidArgumentError, MarkerDetector, PinholeCamera, UnknownNameError
from tests.vision.markers import marker_image

MATRIX = np.array([[521.3, 0.0, 331.7], [0.0, 517.9, 226.4], [0.0, 0.0, 1.0]])
BENT = PinholeCamera.calibrated(MATRIX, (-0.3, 0.12, 0.0012, -0.0009, -0.02), (640, 480))
PLAIN = PinholeCamera.calibrated(MATRIX, (), (640, 480))
SIDE = 0.05  # [m]


def pose(x, y, z, roll=0.0, pitch=0.0, yaw=0.0):
    return pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, yaw), np.array([x, y, z]))


POSES = [
    pose(0.0, 0.0, 0.3), pose(0.06, -0.05, 0.35, 0.3, -0.2, 0.5), pose(-0.1, 0.07, 0.4, -0.35, 0.3, 3.0),
    pose(0.12, 0.08, 0.5, 0.5, 0.1, -1.2),
]  # fmt: skip


@pytest.mark.parametrize("camera", [PLAIN, BENT])
@pytest.mark.parametrize("true", POSES)
@pytest.mark.parametrize(("dictionary", "identity"), [("APRILTAG_36h11", 7), ("4X4_50", 3)])
def test_the_pose_of_a_marker(camera, true, dictionary, identity):
    detector = MarkerDetector(SIDE, identity, dictionary=dictionary)
    image = marker_image(camera, true, SIDE, identity, dictionary)
    found = detector.pose(image, camera)
    error = true.actInv(found)
    assert np.linalg.norm(error.translation) < 0.01 * true.translation[2]  # of the depth
    assert np.linalg.norm(pin.log3(error.rotation)) < np.deg2rad(6.0)  # a small square's tilt is seen badly
    f = camera.focal_length
    expected = f / true.translation[2] * np.array([*true.translation[:2], SIDE])
    off = np.abs(detector(image, camera) - expected)
    assert off[:2].max() < 0.5 * camera.pixel_size
    assert off[2] < 0.01 * expected[2]


def test_without_the_distortion_the_marker_is_found_elsewhere():
    """What the detector cannot know: features off by pixels, many times more than with the lens given."""
    true = POSES[3]
    image, detector = marker_image(BENT, true, SIDE), MarkerDetector(SIDE)
    expected = BENT.focal_length / true.translation[2] * true.translation[:2]
    right, wrong = (np.abs(detector(image, camera)[:2] - expected).max() / BENT.pixel_size for camera in (BENT, PLAIN))
    assert right < 0.5
    assert wrong > max(2.0, 6.0 * right)


def test_not_in_view_cut_off_another_or_twice_is_not_seen():
    detector, shown = MarkerDetector(SIDE, 7), marker_image(PLAIN, POSES[0], SIDE, 7)
    assert detector(shown, PLAIN) is not None
    assert detector(np.full((480, 640, 3), 140, np.uint8), PLAIN) is None
    assert detector(np.random.default_rng(0).integers(0, 255, (480, 640, 3)).astype(np.uint8), PLAIN) is None
    assert detector(marker_image(PLAIN, pose(0.19, 0.0, 0.3), SIDE, 7), PLAIN) is None
    assert MarkerDetector(SIDE, 8)(shown, PLAIN) is None
    two = shown.copy()
    two[:, :320] = np.maximum(two[:, :320], 0)
    two[150:320, 20:190] = shown[140:310, 245:415]
    assert detector(two, PLAIN) is None


@pytest.mark.parametrize(
    "image",
    [np.zeros((480, 640), np.uint8), np.zeros((240, 320, 3), np.uint8), np.zeros((480, 640, 3)), [[1]], None, "image"],
)
@pytest.mark.parametrize("detector", [MarkerDetector(SIDE), ColourDetector()])
def test_what_is_no_image_of_the_camera_is_refused(detector, image):
    with pytest.raises(InvalidArgumentError, match=r"image: must be uint8 of shape \(480, 640, 3\)"):
        detector(image, PLAIN)


def test_a_marker_that_does_not_exist_is_refused():
    with pytest.raises(UnknownNameError, match="Did you mean 'APRILTAG_36h11'"):
        MarkerDetector(SIDE, dictionary="APRILTAG_36h1")
    with pytest.raises(UnknownNameError, match="unknown identity '50'"):
        MarkerDetector(SIDE, 50, dictionary="4X4_50")
    with pytest.raises(InvalidArgumentError, match="side"):
        MarkerDetector(0.0)


COLOURS = {  # blue, green, red; hues
    "orange": ((20, 110, 240), (2, 20)), "yellow": ((20, 230, 240), (25, 35)), "green": ((30, 220, 40), (50, 70)),
    "cyan": ((230, 220, 20), (80, 100)), "blue": ((240, 40, 30), (110, 130)), "magenta": ((230, 20, 220), (140, 160)),
    "red": ((35, 25, 240), (170, 10)),
}  # fmt: skip


@pytest.mark.parametrize("colour", COLOURS)
def test_each_colour_is_found_and_no_other(colour):
    shade, hues = COLOURS[colour]
    image = np.full((480, 640, 3), 140, np.uint8)
    image[200:240, 300:400] = shade
    image[199, 300:400] = np.round(0.5 * np.array(shade) + 70)  # half covered
    camera = PinholeCamera(image_size=(640, 480), field_of_view=1.0)
    found = camera.to_pixels(ColourDetector(hues)(image, camera))
    row = (40 * 219.5 + 0.5 * 199) / 40.5
    np.testing.assert_allclose(found, [349.5, row, np.sqrt(100**2 - 1)], atol=0.02)
    for other, (_, ranges) in COLOURS.items():
        assert other == colour or ColourDetector(ranges)(image, camera) is None
