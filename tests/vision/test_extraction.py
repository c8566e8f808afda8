"""What is found in images that are made here, against the moments of what they show."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phcontrol import PinholeCamera, extract_features

WIDTH, HEIGHT = 120, 90
CAMERA = PinholeCamera(frame="camera", image_size=(WIDTH, HEIGHT), field_of_view=1.0)
ORANGE, GREY, FINENESS = np.array([20.0, 110.0, 240.0]), 150.0, 10


def cover_of(column, row, length, width, turn):
    """How much of each pixel a turned rectangle covers, shape (height, width)."""
    x = (np.arange(WIDTH * FINENESS) + 0.5) / FINENESS - 0.5 - column
    y = (np.arange(HEIGHT * FINENESS) + 0.5) / FINENESS - 0.5 - row
    x, y = np.meshgrid(x, y)
    along, across = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    inside = (np.abs(along) <= 0.5 * length) & (np.abs(across) <= 0.5 * width)
    return inside.reshape(HEIGHT, FINENESS, WIDTH, FINENESS).mean(axis=(1, 3))


def picture(cover):
    return np.round(GREY * (1.0 - cover[..., None]) + ORANGE * cover[..., None]).astype(np.uint8)


def measured(cover):
    """Column, row and length by the eigenvalues of the weighted covariance."""
    rows, columns = np.indices(cover.shape)
    points, weights = np.vstack([columns.ravel(), rows.ravel()]), cover.ravel()
    covariance = np.cov(points, aweights=weights, ddof=0)
    return [*np.average(points, axis=1, weights=weights), np.sqrt(12.0 * np.linalg.eigvalsh(covariance)[-1])]


def found(image):
    return CAMERA.to_pixels(extract_features(image, CAMERA))


@settings(max_examples=25)
@given(st.floats(40, 80), st.floats(35, 55), st.floats(20, 50), st.floats(0.2, 0.6), st.floats(-3.2, 3.2))
def test_moments_are_those_of_what_is_covered(column, row, length, aspect, turn):
    cover = cover_of(column, row, length, aspect * length, turn)
    np.testing.assert_allclose(found(picture(cover)), measured(cover), atol=0.02)  # of 220 levels of red


def test_a_bright_reflection_does_not_pull():
    """A pixel cannot be covered by more than itself."""
    cover = cover_of(60.0, 45.0, 40.0, 16.0, 0.3)
    image = picture(cover)
    image[43:49, 62:70] = (0, 60, 255)
    np.testing.assert_allclose(found(image), measured(cover), atol=0.02)


def test_the_covered_parts_of_the_outermost_pixels_count():
    """Coloured less than what counts as orange, but not nothing: at each border of the image in turn."""
    for column, row in [(20.3, 45.0), (WIDTH - 21.3, 45.0), (60.0, 9.3), (60.0, HEIGHT - 10.3)]:
        cover = cover_of(column, row, 40.0, 18.0, 0.0)
        np.testing.assert_allclose(found(picture(cover)), measured(cover), atol=0.02)


def spot(top, left, height, width):
    image = np.full((HEIGHT, WIDTH, 3), GREY, dtype=np.uint8)
    image[top : top + height, left : left + width] = ORANGE
    return image


@pytest.mark.parametrize(("top", "left"), [(1, 30), (30, 1), (HEIGHT - 11, 30), (30, WIDTH - 21)])
def test_one_pixel_from_the_border_it_is_seen_and_at_the_border_not(top, left):
    pixels = found(spot(top, left, 10, 20))
    np.testing.assert_allclose(pixels[:2], [left + 9.5, top + 4.5], atol=1e-9)
    assert pixels[2] == pytest.approx(np.sqrt(20**2 - 1))  # of 20 points one pixel apart
    moved = {1: 0, HEIGHT - 11: HEIGHT - 10, WIDTH - 21: WIDTH - 20}
    assert extract_features(spot(moved.get(top, top), moved.get(left, left), 10, 20), CAMERA) is None


BIG_ENOUGH = [(5, 8), (8, 5), (3, 14), (14, 3)]
TOO_SMALL = [(3, 13), (13, 3), (2, 40), (40, 2)]


@pytest.mark.parametrize(("height", "width"), BIG_ENOUGH + TOO_SMALL)
def test_spots_of_forty_pixels_that_are_three_wide_count(height, width):
    seen = extract_features(spot(30, 40, height, width), CAMERA) is not None
    assert seen is ((height, width) in BIG_ENOUGH)


def test_the_largest_of_several_spots_is_taken_wherever_it_stands():
    """And what touches it at a corner alone is not part of it."""
    for first, second in [((10, 10, 20, 30), (60, 70, 8, 12)), ((10, 10, 8, 12), (60, 70, 20, 30))]:
        image = np.minimum(spot(*first), np.full(3, 255)).astype(np.uint8)
        other = spot(*second)
        image[other[..., 2] > 200] = ORANGE
        top, left, height, width = max(first, second, key=lambda s: s[2] * s[3])
        np.testing.assert_allclose(found(image)[:2], [left + (width - 1) / 2, top + (height - 1) / 2], atol=1e-9)


@pytest.mark.parametrize(
    ("colour", "seen"),
    [
        ((20, 110, 240), True),  # hue 12
        ((40, 42, 240), False),  # red
        ((20, 200, 240), False),  # yellow
        ((200, 110, 20), False),  # blue
        ((100, 150, 200), False),  # pale
        ((4, 22, 48), False),  # dark
    ],
)
def test_only_orange_counts(colour, seen):
    image = np.full((HEIGHT, WIDTH, 3), GREY, dtype=np.uint8)
    image[30:50, 40:80] = colour
    assert (extract_features(image, CAMERA) is not None) is seen
