"""The lens: OpenCV's own functions on the same camera."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from phcontrol import InvalidArgumentError, ObservedObject, PinholeCamera, Renderer, extract_features
from phcontrol.vision.lens_distortion import LensDistortion
from tests.conftest import make_system

LENSES = {
    "none": (),
    "barrel": (-0.28, 0.07, 0.001, -0.0007),
    "five": (-0.3, 0.12, 0.0012, -0.0009, -0.02),
    "rational": (0.4, -0.2, 0.001, 0.0005, 0.03, 0.7, -0.1, 0.02),
    "prism": (-0.2, 0.05, 0.001, 0.002, 0.0, 0.0, 0.0, 0.0, 0.004, -0.001, 0.003, 0.002),
    "untilted": (-0.2, 0.05, 0.001, 0.002, 0.0, 0.0, 0.0, 0.0, 0.004, -0.001, 0.003, 0.002, 0.0, 0.0),
}
MATRIX = np.array([[521.3, 0.0, 331.7], [0.0, 517.9, 226.4], [0.0, 0.0, 1.0]])


def camera(lens, **arguments):
    return PinholeCamera.calibrated(MATRIX, LENSES[lens], (640, 480), **arguments)


@pytest.mark.parametrize("lens", LENSES)
def test_points_are_shown_where_opencv_shows_them_and_back(lens):
    made = camera(lens, focal_length=0.004)
    np.testing.assert_allclose(made.matrix, MATRIX, rtol=1e-13)
    generator = np.random.default_rng(3)
    points = generator.uniform([-0.55, -0.4, 1.0], [0.55, 0.4, 1.0], (200, 3)) * generator.uniform(0.3, 3.0, (200, 1))
    theirs = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, np.array(LENSES[lens] or [0.0] * 4))[0][:, 0]
    plane = 0.004 * points[:, :2] / points[:, 2:]
    np.testing.assert_allclose(made.to_image(plane), theirs, atol=1e-9)
    np.testing.assert_allclose(made.from_image(theirs), plane, atol=1e-14)
    features = [1e-3, -5e-4, 7e-4]
    np.testing.assert_allclose(made.from_pixels(made.to_pixels(features)), features, atol=1e-14)


@pytest.mark.parametrize("lens", [lens for lens in LENSES if lens != "none"])
def test_areas_and_derivatives_are_those_of_the_map(lens):
    bent = LensDistortion(LENSES[lens])
    point, h = np.array([0.31, -0.22]), 1e-6
    columns = [(bent.distorted(point + step) - bent.distorted(point - step)) / (2 * h) for step in h * np.eye(2)]
    assert bent.jacobian_determinant(point) == pytest.approx(np.linalg.det(np.array(columns).T), rel=1e-8)


@pytest.mark.parametrize("lens", [(-0.03, 0.87, -0.11, 0.06, -0.5), (0.83, -0.41, -0.05, 0.0, 0.05)])
def test_points_found_beyond_a_fold_are_none(lens):
    """Where the map turns a small triangle over, the image shows another point too, nearer to the middle."""
    bent, generator = LensDistortion(lens), np.random.default_rng(5)
    found = bent.undistorted(generator.uniform(-2.0, 2.0, (400, 2)))
    seen = found[np.isfinite(found[:, 0])]
    sides = [bent.distorted(seen + step) - bent.distorted(seen - step) for step in 1e-6 * np.eye(2)]
    assert (sides[0][:, 0] * sides[1][:, 1] > sides[0][:, 1] * sides[1][:, 0]).all()
    assert 50 < len(seen) < 350


def test_what_is_in_the_image_is_seen_and_nothing_that_folds_back_into_it():
    made = PinholeCamera.calibrated(MATRIX, (-0.2, 0.0, 0.0, 0.0), (640, 480))
    left, top, right, bottom = made.bounds
    assert made.sees(np.array([*made.from_image([0.0, 0.0]), 1e-3]))
    assert not made.sees(np.array([left, top, 1e-3])) or np.all(made.to_image([left, top]) >= -0.5)
    assert made.half_size[0] == min(-left, right)
    far = np.array([0.0, 0.021, 1e-3])  # the polynomial brings 2.1 back to where the image is
    assert 0.0 <= made.to_image(far[:2])[1] <= 479.5
    assert not made.sees(far)
    assert "has left the image" in made.why_not_seen(far)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"distortion": (0.1, 0.2, 0.3)}, "must hold 0, 4, 5, 8, 12, 14 coefficients"),
        ({"distortion": (np.nan, 0.0, 0.0, 0.0)}, "must be finite|not finite"),
        ({"distortion": (-3.0, 0.0, 0.0, 0.0)}, "folds within the image"),
        ({"distortion": (0.0,) * 12 + (0.1, 0.0)}, "tilted sensor"),
        ({"principal_point": (900.0, 200.0)}, "must be in the image"),
        ({"pixel_aspect": 0.0}, "pixel_aspect"),
        ({"image_size": None, "principal_point": (1.0, 1.0)}, "is that of an image"),
        ({"image_size": None, "distortion": (0.1, 0.0, 0.0, 0.0)}, "is that of an image"),
    ],
)
def test_what_no_lens_does_is_refused(arguments, problem):
    with pytest.raises(InvalidArgumentError, match=problem):
        PinholeCamera(**({"image_size": (640, 480), "field_of_view": 1.0} | arguments))


@pytest.mark.parametrize(
    "matrix",
    [
        np.eye(2),
        [[500.0, 3.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]],
        [[500.0, 0.0, 320.0], [0.0, -500.0, 240.0], [0.0, 0.0, 1.0]],
        [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 2.0]],
    ],
)
def test_a_matrix_that_is_no_cameras_is_refused(matrix):
    with pytest.raises(InvalidArgumentError, match="camera_matrix"):
        PinholeCamera.calibrated(matrix)


def scene(made, features, turn):
    """An object far enough to face the camera as a plane would, seen as stated."""
    x = make_system("pera").at(make_system("pera").robot.home)
    return x, ObservedObject.seen_as(made.mounted_on(x.system.robot), features, x, (0.1, 0.04, 0.01), turn)


@pytest.mark.parametrize("lens", ["barrel", "five", "rational"])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.0035, 0.0025), (-0.004, 0.002)])
def test_features_of_a_distorted_image_are_those_without_the_lens(lens, place):
    """And without the distortion given they are not: by many times what the right camera is off."""
    made = camera(lens)
    seen = np.array([*place, 0.0018])
    x, thing = scene(made, seen, 0.4)
    image = Renderer(thing, blur=0.5).render(x.placement("camera"))
    pixel = made.pixel_size
    right = np.abs(extract_features(image, made) - seen) / pixel
    assert right[:2].max() < 0.03  # pixels
    plain = camera("none")  # what drawing leaves without a lens, too: it differs between versions of OpenCV
    x, thing = scene(plain, seen, 0.4)
    drawn = np.abs(extract_features(Renderer(thing, blur=0.5).render(x.placement("camera")), plain) - seen) / pixel
    assert right[2] < drawn[2] + 0.1
    ignorant = np.abs(extract_features(image, camera("none")) - seen) / pixel
    if place != (0.0, 0.0):
        assert ignorant.max() > 2.0  # pixels
        assert ignorant.max() > 10.0 * right.max()


def test_where_the_lens_folds_nothing_is_drawn():
    made = camera("barrel")
    x, thing = scene(made, [0.022, 0.0, 0.0018], 0.0)
    image = Renderer(thing).render(x.placement("camera"))
    assert extract_features(image, made) is None
