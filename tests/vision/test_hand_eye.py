"""Where the camera is in the hand: true poses, poses with noise, and images of a marker."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    HandEyeCalibration,
    InvalidArgumentError,
    MarkerDetector,
    PHControlError,
    PinholeCamera,
    UnknownNameError,
    calibrate_hand_eye,
    load_robot,
)
from phcontrol.vision.hand_eye import _closed_form, _refined
from tests.vision.markers import marker_image

X = pin.SE3(pin.rpy.rpyToMatrix(0.2, -0.1, 1.5), np.array([0.04, -0.06, 0.02]))
W = pin.SE3(pin.rpy.rpyToMatrix(3.0, 0.1, 0.3), np.array([0.5, 0.1, 0.05]))


def looks(count, generator, rotation=0.0, translation=0.0, spread=0.45):
    """Poses of a hand above a marker, and of the marker as the camera sees it, with noise."""
    hands, markers = [], []
    for _ in range(count):
        tilt = pin.exp3(generator.uniform(-spread, spread, 3))
        seen = pin.SE3(tilt, np.array([*generator.uniform(-0.05, 0.05, 2), generator.uniform(0.25, 0.4)]))
        hands.append(W * seen.inverse() * X.inverse())
        noise = pin.SE3(pin.exp3(rotation * generator.standard_normal(3)), translation * generator.standard_normal(3))
        markers.append(seen * noise)
    return hands, markers


def test_true_poses_give_the_true_camera(rng):
    found = calibrate_hand_eye(*looks(6, rng))
    np.testing.assert_allclose(found.camera.homogeneous, X.homogeneous, atol=1e-9)
    np.testing.assert_allclose(found.marker.homogeneous, W.homogeneous, atol=1e-9)
    assert found.rotation_residual < 1e-9
    assert found.translation_error < 1e-9


def test_it_is_refined_to_the_end(rng):
    """Also from a first guess 10 cm and half a radian away."""
    hands, markers = looks(6, rng)
    first = X * pin.exp6(np.array([0.06, -0.07, 0.05, 0.3, -0.3, 0.3]))
    np.testing.assert_allclose(_refined(hands, markers, first)[2].homogeneous, X.homogeneous, atol=1e-10)


def test_matrices_do_as_well(rng):
    hands, markers = looks(6, rng)
    printed = [np.round(hand.homogeneous, 7) for hand in hands]
    found = calibrate_hand_eye(printed, [marker.homogeneous for marker in markers])
    np.testing.assert_allclose(found.camera.homogeneous, X.homogeneous, atol=1e-6)


def test_noise_is_averaged_and_its_size_is_told_truly():
    """Over 40 calibrations: residuals as large as the noise, errors as large as the standard errors that are told."""
    rotation, translation, turned, moved, told = 0.01, 0.001, [], [], []
    for seed in range(40):
        hands, markers = looks(15, np.random.default_rng(seed), rotation, translation)
        found = calibrate_hand_eye(hands, markers)
        off = X.actInv(found.camera)
        turned.append(np.linalg.norm(pin.log3(off.rotation)))
        moved.append(np.linalg.norm(off.translation))
        told.append(
            [found.rotation_error, found.translation_error, found.rotation_residual, found.translation_residual]
        )
    rotation_error, translation_error, rotation_residual, translation_residual = np.median(told, axis=0)
    assert rotation_residual == pytest.approx(np.sqrt(3) * rotation, rel=0.2)
    assert translation_residual == pytest.approx(np.sqrt(3) * translation, rel=0.7)
    # of a vector of three whose worst direction has that standard error
    assert 0.5 * rotation_error < np.median(turned) < 2.0 * rotation_error
    assert 0.5 * translation_error < np.median(moved) < 2.0 * translation_error


OPENCV = pin.SE3(
    np.array(
        [
            [0.070130287, -0.980197021, 0.185190557],
            [0.992223558, 0.049406653, -0.114242696],
            [0.102830705, 0.191762306, 0.976039479],
        ]
    ),
    np.array([0.041719587, -0.059437317, 0.023891668]),
)
"""What calibrateHandEye of OpenCV 4.14 finds by Park's method; OpenCV 5.0 has no such function in Python."""


def test_it_begins_with_what_opencv_finds_and_ends_nearer_to_the_truth():
    hands, markers = looks(10, np.random.default_rng(4), 0.01, 0.001)
    np.testing.assert_allclose(_closed_form(hands, markers).homogeneous, OPENCV.homogeneous, atol=1e-8)
    found = calibrate_hand_eye(hands, markers)
    theirs, ours = (np.linalg.norm(each.translation - X.translation) for each in (OPENCV, found.camera))
    assert ours < 2.0 * found.translation_error
    assert ours < 0.5 * theirs


MATRIX = [[521.3, 0.0, 331.7], [0.0, 517.9, 226.4], [0.0, 0.0, 1.0]]
BENT = PinholeCamera.calibrated(MATRIX, (-0.3, 0.12, 0.0012, -0.0009, -0.02), (640, 480))
PLAIN = PinholeCamera.calibrated(MATRIX, (), (640, 480))


@pytest.fixture(scope="module")
def pictures():
    """Images of a marker of 12 cm from twelve poses, all over the image, through a lens that bends."""
    generator, hands, images = np.random.default_rng(1), [], []
    while len(images) < 12:
        seen = pin.SE3(
            pin.exp3(generator.uniform(-0.5, 0.5, 3)),
            np.array([*generator.uniform([-0.13, -0.09], [0.13, 0.09]), generator.uniform(0.35, 0.45)]),
        )
        image = marker_image(BENT, seen, 0.12)
        if MarkerDetector(0.12).pose(image, BENT) is not None:
            images.append(image)
            hands.append(W * seen.inverse() * X.inverse())
    return hands, images


def test_from_images_and_not_without_the_lens(pictures):
    hands, images = pictures
    detector = MarkerDetector(0.12)
    found = calibrate_hand_eye(hands, [detector.pose(image, BENT) for image in images])
    off = X.actInv(found.camera)
    assert np.linalg.norm(off.translation) < 0.002
    assert np.linalg.norm(pin.log3(off.rotation)) < 0.01
    unseen = [detector.pose(image, PLAIN) is None for image in images]
    assert any(unseen)  # corners that no square has there
    lenient = MarkerDetector(0.12, largest_error=50.0)
    ignorant = [lenient.pose(image, PLAIN) for image in images]
    with pytest.raises(PHControlError, match="is the lens's distortion missing"):
        calibrate_hand_eye(hands, ignorant)


def turned(hands, how):
    return [how(hand) for hand in hands]


def test_what_does_not_agree_is_refused(rng):
    hands, markers = looks(10, rng, 0.002, 2e-4)
    calibrate_hand_eye(hands, markers)
    moved = [pin.SE3(m.rotation, m.translation + (k > 4) * np.array([0.05, 0.0, 0.0])) for k, m in enumerate(markers)]
    wrong = {
        "marker moved": (hands, moved),
        "hands the wrong way round": ([hand.inverse() for hand in hands], markers),
        "markers the wrong way round": (hands, [marker.inverse() for marker in markers]),
        "others": (hands, markers[1:] + markers[:1]),
        "millimetres": (hands, [pin.SE3(m.rotation, 1e3 * m.translation) for m in markers]),
    }
    for name, poses in wrong.items():
        with pytest.raises(PHControlError, match="do not agree"):
            pytest.fail(f"{name}: {calibrate_hand_eye(*poses)}")
    assert isinstance(
        calibrate_hand_eye(hands, moved, largest_rotation=1.0, largest_translation=1.0), HandEyeCalibration
    )


def test_degenerate_motions_are_refused():
    still = [pin.SE3.Identity() for _ in range(8)]
    angles = np.linspace(-1, 1, 8)
    about_one = [pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, a), np.array([0.1 * a, 0.2, 0.3])) for a in angles]
    barely = [pin.SE3(pin.rpy.rpyToMatrix(0.05 * np.sin(9 * a), 0.0, a), np.zeros(3)) for a in angles]
    shifted = [pin.SE3(np.eye(3), np.array([a, a * a, -a])) for a in angles]
    for hands in (still, about_one, barely, shifted):
        markers = [X.inverse() * hand.inverse() * W for hand in hands]
        with pytest.raises(InvalidArgumentError, match="must turn about at least two directions"):
            calibrate_hand_eye(hands, markers)


def replaced(poses, k, matrix):
    return [*poses[:k], matrix, *poses[k + 1 :]]


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        (np.diag([1.0, 1.0, -1.0, 1.0]), "pose 2 must have a rotation"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "pose 2 must have a rotation"),
        (np.zeros((4, 4)), "last row 0, 0, 0, 1"),
        (np.full((4, 4), np.nan), "finite"),
        (np.eye(3), "or a \\(4, 4\\) matrix"),
        (pin.SE3(np.ones((3, 3)), np.zeros(3)), "pose 2 must have a rotation"),
        (pin.SE3(np.eye(3), np.array([np.inf, 0.0, 0.0])), "finite"),
        (None, "real numbers"),
        ("pose", "real numbers"),
    ],
)
def test_a_pose_that_is_none_is_refused(rng, wrong, problem):
    hands, markers = looks(6, rng)
    with pytest.raises(InvalidArgumentError, match=f"hands.*{problem}"):
        calibrate_hand_eye(replaced(hands, 2, wrong), markers)
    with pytest.raises(InvalidArgumentError, match=f"markers.*{problem}"):
        calibrate_hand_eye(hands, replaced(markers, 2, wrong))


def test_too_few_or_unequal_are_refused(rng):
    hands, markers = looks(6, rng)
    for first, second, problem in [
        (hands, markers[:5], "as many"),
        (hands[:3], markers[:3], "at least 4"),
        (hands[0], markers, "must be a sequence"),
        (5, markers, "must be a sequence"),
    ]:
        with pytest.raises(InvalidArgumentError, match=problem):
            calibrate_hand_eye(first, second)


def test_the_camera_is_mounted_where_it_was_found(rng):
    robot = load_robot("pera")
    found = calibrate_hand_eye(*looks(6, rng)).camera
    with_camera = robot.with_frame("eye", "hand", found)
    q = robot.random_position(rng)
    place = robot.placement("hand", q) * X
    np.testing.assert_allclose(with_camera.placement("eye", q).homogeneous, place.homogeneous, atol=1e-8)
    assert PinholeCamera(frame="eye").mounted_on(with_camera).frame == "eye"
    assert "eye" not in robot.frame_names
    with pytest.raises(InvalidArgumentError, match="is a frame of pera already"):
        robot.with_frame("hand", "hand", found)
    with pytest.raises(UnknownNameError, match="unknown frame 'foot'"):
        robot.with_frame("eye", "foot", found)
    with pytest.raises(InvalidArgumentError, match="must be a rotation matrix"):
        robot.with_frame("eye", "hand", np.diag([1.0, 1.0, -1.0, 1.0]))
