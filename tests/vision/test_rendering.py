"""Rendered images against rays traced through the box, a Gaussian of SciPy's, and the noise asked for."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.ndimage import gaussian_filter

from phcontrol import InvalidArgumentError, ObservedObject, PinholeCamera, Renderer
from phcontrol.vision.extraction import HUES, LEAST_SATURATION, LEAST_VALUE
from phcontrol.vision.rendering import FACE, SIDES

WIDTH, HEIGHT, ANGLE = 90, 64, np.deg2rad(50.0)
CAMERA = PinholeCamera(frame="camera", image_size=(WIDTH, HEIGHT), field_of_view=ANGLE)
SIZE = np.array([0.05, 0.02, 0.03])
# of the seen face, then of the back, and of the sides at −y, +y, −x, +x of the box's own axes
COLOURS = np.array([FACE, *SIDES], dtype=float)
FACE_OF = {(2, False): 0, (2, True): 1, (1, False): 2, (1, True): 3, (0, False): 4, (0, True): 5}


def pose_towards(point, direction, distance, roll=0.0):
    """A camera that looks at a point from a direction."""
    forward = -np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    right = np.cross([0.3, 0.2, 1.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.column_stack([right, np.cross(forward, right), forward])
    return pin.SE3(rotation @ pin.utils.rotate("z", roll), np.asarray(point) - distance * forward)


def traced(scene, pose, fineness=8):
    """The image of rays through the box by the method of slabs, ``fineness``² of them for each pixel."""
    half = np.tan(ANGLE / 2.0) * np.array([1.0, HEIGHT / WIDTH])
    across = (np.arange(WIDTH * fineness) + 0.5) / (WIDTH * fineness) * 2.0 - 1.0
    down = (np.arange(HEIGHT * fineness) + 0.5) / (HEIGHT * fineness) * 2.0 - 1.0
    x, y = np.meshgrid(half[0] * across, half[1] * down)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ pose.rotation.T @ scene.rotation
    origin = scene.rotation.T @ (pose.translation - scene.position)
    low, high = np.array([-0.5, -0.5, 0.0]) * SIZE, np.array([0.5, 0.5, 1.0]) * SIZE
    with np.errstate(divide="ignore"):
        to_low, to_high = (low - origin) / rays, (high - origin) / rays
    enters, leaves = np.minimum(to_low, to_high), np.maximum(to_low, to_high)
    axis = enters.argmax(axis=-1)
    hit = (enters.max(axis=-1) < leaves.min(axis=-1)) & (enters.max(axis=-1) > 0.0)
    from_high = np.take_along_axis(rays, axis[..., None], -1)[..., 0] < 0.0
    face = np.vectorize(lambda a, h: FACE_OF[a, h])(axis, from_high)
    ground = np.repeat(np.linspace(190.0, 120.0, HEIGHT).astype(np.uint8), fineness)[:, None, None]
    image = np.where(hit[..., None], COLOURS[face], ground.astype(float))
    return image.reshape(HEIGHT, fineness, WIDTH, fineness, 3).mean(axis=(1, 3))


VIEWS = {
    "face": (0.0, 0.0, -1.0),
    "face, -x, -y": (-0.9, -0.8, -1.0),
    "face, +x, +y": (1.0, 0.9, -0.8),
    "back, -x, +y": (-0.7, 1.0, 0.9),
    "back, +x, -y": (1.0, -0.6, 0.8),
}


@pytest.mark.parametrize("view", list(VIEWS))
def test_the_box_is_drawn_as_rays_see_it(view, rng):
    """Each pixel by the faces' shares in it: exact inside a face, at edges to the line a fine pixel wide around it."""
    turn = pin.utils.rotate("x", 0.3) @ pin.utils.rotate("z", -0.8)
    scene = ObservedObject(CAMERA, [0.2, -0.1, 0.4], SIZE, turn)
    pose = pose_towards(scene.position + turn @ [0.004, -0.003, 0.01], turn @ np.array(VIEWS[view]), 0.12, roll=0.5)
    image, expected = Renderer(scene, blur=0.0).render(pose), traced(scene, pose)
    assert (np.abs(expected - expected[:, :1]) > 1.0).any(axis=2).sum() > 200  # the box is there
    difference = np.abs(image - expected).max(axis=2)
    assert (difference > 1.0).mean() < 0.08  # the pixels of the edges
    assert difference.max() < 0.2 * 240.0
    assert abs((image - expected).mean()) < 0.15


@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
def test_a_box_that_leaves_the_image_is_cut_off_at_its_border(side):
    aside = {"left": [0.045, 0, 0], "right": [-0.045, 0, 0], "top": [0, 0.03, 0], "bottom": [0, -0.03, 0]}[side]
    scene = ObservedObject(CAMERA, [0.0, 0.0, 0.1], SIZE)
    pose = pin.SE3(pin.utils.rotate("z", 0.4), np.array(aside))
    image, expected = Renderer(scene, blur=0.0).render(pose), traced(scene, pose)
    border = {"left": image[:, 0], "right": image[:, -1], "top": image[0], "bottom": image[-1]}[side]
    assert (border[:, 2] > border[:, 0]).any()  # it is orange there
    assert np.abs(image - expected).max() < 0.2 * 240.0
    assert abs((image - expected).mean()) < 0.15


def test_a_very_near_box_is_drawn_too():
    """It fills the image and more: the fine picture that it is drawn in stays small."""
    camera = PinholeCamera(frame="camera", image_size=(1200, 900), field_of_view=ANGLE)
    scene = ObservedObject(camera, [0.0, 0.0, 0.012], SIZE)
    image = Renderer(scene, blur=0.0).render(pin.SE3.Identity())
    assert (image == FACE).all()
    behind_the_lens = ObservedObject(camera, [0.0, 0.0, 0.0009], SIZE)
    image = Renderer(behind_the_lens, blur=0.0).render(pin.SE3.Identity())
    assert (image[..., 0] == image[..., 2]).all()
    assert (Renderer(ObservedObject(camera, [0, 0, 0.0011], SIZE), blur=0.0).render(pin.SE3.Identity()) == FACE).all()


def test_only_the_seen_face_is_coloured():
    """A pixel is as red as it is covered by that face; the face's colour is the one that is looked for."""
    for side in SIDES:
        assert len(set(side)) == 1
        assert side[0] < 120  # darker than any ground
    assert len(set(SIDES)) == 5
    blue, green, red = FACE
    hue = 30.0 * (green - blue) / (red - blue)  # OpenCV's, from 0 to 180, between red and yellow
    assert HUES[0] + 5 < hue < HUES[1] - 5
    assert 255 * (red - blue) / red > 1.5 * LEAST_SATURATION
    assert red > 3 * LEAST_VALUE


def test_the_lens_blurs_as_a_gaussian_does():
    scene = ObservedObject(CAMERA, [0.0, 0.0, 0.15], SIZE)
    sharp = Renderer(scene, blur=0.0).render(pin.SE3.Identity()).astype(float)
    for blur in (0.8, 1.0, 2.0):
        blurred = Renderer(scene, blur=blur).render(pin.SE3.Identity())
        expected = gaussian_filter(sharp, (blur, blur, 0.0), mode="mirror", truncate=3.0)
        assert np.abs(blurred - expected).max() < 3.0
    np.testing.assert_array_equal(
        Renderer(scene).render(pin.SE3.Identity()), Renderer(scene, blur=1.0).render(pin.SE3.Identity())
    )


def test_grey_noise_has_its_size_in_each_colour_and_is_new_in_each_image():
    scene = ObservedObject(CAMERA, [0.0, 0.0, -1.0], SIZE)
    clean = Renderer(scene, blur=0.0).render(pin.SE3.Identity()).astype(float)
    renderer, generator = Renderer(scene, blur=0.0, grey_noise=6.0), np.random.default_rng(3)
    noise = np.array([renderer.render(pin.SE3.Identity(), generator) for _ in range(4)]) - clean
    assert noise.std(axis=(0, 1, 2)) == pytest.approx(6.0, rel=0.03)
    assert np.abs(noise.mean(axis=(0, 1, 2))).max() < 5.0 * 6.0 / np.sqrt(4 * WIDTH * HEIGHT)
    samples = noise.reshape(4, -1)
    correlation = np.corrcoef([*samples, samples[0].reshape(-1, 3)[:, [1, 2, 0]].ravel()])
    assert np.abs(correlation - np.eye(5)).max() < 0.05
    np.testing.assert_array_equal(renderer.render(pin.SE3.Identity()), clean)  # no generator, no noise
    corners = {renderer.render(pin.SE3.Identity(), generator)[:2].tobytes() for _ in range(60)}
    assert len(corners) == 60


def test_each_corner_is_displaced_by_itself():
    """The spread of a rectangle's area and centroid under independent displacements of its corners."""
    scene = ObservedObject(CAMERA, [0.0, 0.0, 0.1], [0.05, 0.02, 1e-6])
    renderer, generator = Renderer(scene, blur=0.0, corner_noise=1.5), np.random.default_rng(0)
    weights = np.indices((HEIGHT, WIDTH))

    def measures(image):
        cover = (image[..., 2].astype(float) - image[..., 0]) / (FACE[2] - FACE[0])
        area = cover.sum()
        return area, (weights[1] * cover).sum() / area, (weights[0] * cover).sum() / area

    def polygon(corners):
        x, y = corners.T
        following = np.roll(corners, -1, axis=0)
        cross = x * following[:, 1] - following[:, 0] * y
        area = 0.5 * cross.sum()
        middle = ((corners + following) * cross[:, None]).sum(axis=0) / (6.0 * area)
        return area, *middle

    scale = WIDTH / (2.0 * np.tan(ANGLE / 2.0)) / 0.1
    ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.5 * scale * SIZE[:2] + [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]
    drawn = np.array([measures(renderer.render(pin.SE3.Identity(), generator)) for _ in range(300)])
    simulated = np.array([polygon(ring + 1.5 * generator.normal(size=(4, 2))) for _ in range(3000)])
    np.testing.assert_allclose(drawn.std(axis=0), simulated.std(axis=0), rtol=0.15)  # 300 samples: ±4 % each σ
    np.testing.assert_allclose(drawn.mean(axis=0), simulated.mean(axis=0), rtol=0.02)


@pytest.mark.parametrize("name", ["blur", "corner_noise", "grey_noise"])
def test_sizes_of_noise_below_zero_are_refused(name):
    scene = ObservedObject(CAMERA, [0.0, 0.0, 0.1])
    Renderer(scene, **{name: 0.0})
    with pytest.raises(InvalidArgumentError, match=f"{name}: must be >= 0"):
        Renderer(scene, **{name: -0.1})
