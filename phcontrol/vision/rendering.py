"""Images of a box as a camera would take them (needs OpenCV)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from phcontrol._validation import Array, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.opencv import load_opencv

if TYPE_CHECKING:
    from phcontrol.vision.pinhole_camera import PinholeCamera

Image = NDArray[np.uint8]
"""Shape (height, width, 3): blue, green, red."""

FACE = (20, 110, 240)
"""Colour of the face that is looked at (blue, green, red)."""
SIDES = ((95, 95, 95), (80, 80, 80), (70, 70, 70), (60, 60, 60), (50, 50, 50))
"""Colours of the other faces: grey, so that a pixel is as red as it is covered by the seen face."""
_NEAR = 1e-3  # [m]: what is nearer than this is not drawn
_SUBPIXEL_BITS = 6
_SIDE_POINTS = 24  # along each side of a face, where a lens bends it
_PRINT_FINENESS = 4
_FINENESS, _FINE_PIXELS = 8, 4e6  # how much finer than the image the box is drawn, and how many fine pixels at most
# corners as signs of (length, width) and 0 or 1 for depth; faces as rings of corners, seen from outside
_CORNERS = np.array([(a, b, c) for c in (0.0, 1.0) for b in (-0.5, 0.5) for a in (-0.5, 0.5)])
_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


class Print(Protocol):
    """What is printed on the face that is looked at, as :class:`MarkerPrint` is."""

    def shades(self, directions: Array, corners: Array) -> Image:
        """Return how bright the face with these corners (4, 3) [m] is along lines of sight (X, Y)/Z, (h, w, 2)."""
        ...


class Renderer:
    """Draws what the camera of a scene sees: the box on a grey ground, blurred by the lens, with noise.

    Args:
        scene: the box and its camera, which must have an ``image_size``.
        blur: standard deviation of the lens's blur [pixels].
        corner_noise: by how much each corner of the box is displaced in each image, standard deviation [pixels]: what
            an uneven exposure, a rolling shutter or a shaking mount do.
        printed: on the seen face, in place of its colour.
        grey_noise: of each pixel's each colour, standard deviation [of 255 levels].

    Example:
        >>> from phcontrol import MechanicalSystem, ObservedObject, PinholeCamera, Renderer, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.home)
        >>> camera = PinholeCamera(image_size=(64, 48), field_of_view=1.2).mounted_on(system.robot)
        >>> thing = ObservedObject.seen_as(camera, [0.001, 0.0, 0.0025], x)
        >>> image = Renderer(thing).render(x.placement(camera.frame))
        >>> image.shape, image.dtype
        ((48, 64, 3), dtype('uint8'))
    """

    def __init__(
        self,
        scene: ObservedObject,
        *,
        blur: float = 1.0,
        corner_noise: float = 0.0,
        grey_noise: float = 0.0,
        printed: Print | None = None,
    ) -> None:
        if scene.camera.image_size is None:
            raise InvalidArgumentError("scene", "its camera has no pixels: give image_size and field_of_view")
        self.scene = scene
        self.camera: PinholeCamera = scene.camera
        self.blur = number("blur", blur, minimum=0.0)
        self.corner_noise = number("corner_noise", corner_noise, minimum=0.0)
        self.grey_noise = number("grey_noise", grey_noise, minimum=0.0)
        self.printed = printed
        width, height = scene.camera.image_size
        if printed is not None:
            pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
            self._directions = (self.camera.from_image(pixels) / self.camera.focal_length).astype(np.float32)
        ground = np.linspace(190.0, 120.0, height)[:, None, None]
        self._ground = np.broadcast_to(ground, (height, width, 3)).astype(np.uint8)
        self._opencv: Any = load_opencv()

    def render(self, placement: pin.SE3, generator: np.random.Generator | None = None) -> Image:
        """Return the image that is taken from a pose of the camera in the world; noise needs a generator."""
        cv = self._opencv
        image: Image = self._ground.copy()
        corners = self.corners(placement)
        if corners[:, 2].min() > _NEAR and self._can_show(corners):
            if generator is not None and self.corner_noise:
                shaken = self._project(corners) + self.corner_noise * generator.standard_normal((8, 2))
                plane = self.camera.from_image(shaken) / self.camera.focal_length
                if np.isfinite(plane).all():  # else it is where the lens folds
                    corners = np.column_stack([plane, np.ones(8)]) * corners[:, 2:]
            self._draw(image, corners)
        if self.blur:
            image = cv.GaussianBlur(image, (0, 0), self.blur)
        if generator is not None and self.grey_noise:
            cv.setRNGSeed(int(generator.integers(2**31)))
            # a bare number would be the first colour's alone
            noise = cv.randn(np.empty(image.shape, dtype=np.int16), (0.0,) * 3, (self.grey_noise,) * 3)
            image = cv.add(image, noise, dtype=cv.CV_8U)
        return image

    def _can_show(self, corners: Array) -> bool:
        """Whether the model of the lens holds for corners: far outside the image it folds back into it."""
        if not self.camera.distortion:
            return True
        points = self.camera.focal_length * corners[:, :2] / corners[:, 2:]
        again = self.camera.from_image(self.camera.to_image(points))
        return bool(np.abs(again - points).max() < 1e-9)

    def _draw(self, image: Image, corners: Array) -> None:
        """Draw the faces that are turned to the camera, several times finer than the image, and mix them in."""
        cv = self._opencv
        height, width = image.shape[:2]
        rings = [self._project(self._ring(corners[list(face)])) for face in _FACES]
        pixels = np.concatenate(rings)
        low = np.maximum(np.floor(pixels.min(axis=0)) - 1.0, 0.0)
        high = np.minimum(np.ceil(pixels.max(axis=0)) + 2.0, (width, height))
        if (high <= low).any():
            return
        left, top, right, bottom = (int(value) for value in (*low, *high))
        area = (right - left) * (bottom - top)
        finest = _FINENESS if self.printed is None else _PRINT_FINENESS
        fineness = int(np.clip(np.sqrt(_FINE_PIXELS / area), 1, finest))
        shape = (fineness * (bottom - top), fineness * (right - left))
        color, cover = np.zeros((*shape, 3), dtype=np.uint8), np.zeros(shape, dtype=np.uint8)
        centre = corners.mean(axis=0)
        for order in reversed(range(len(_FACES))):  # the seen face last
            ring = corners[list(_FACES[order])]
            normal = np.cross(ring[1] - ring[0], ring[2] - ring[0])
            if normal.dot(ring[0] - centre) * normal.dot(ring[0]) < 0.0:  # its outer side is towards the camera
                # a pixel's centre is at a whole number, a fine pixel's too: (x + ½)·fineness − ½
                fine = (rings[order] - low + 0.5) * fineness - 0.5
                points = np.clip(np.round(fine * 2**_SUBPIXEL_BITS), -(2.0**30), 2.0**30).astype(np.int32)
                for canvas, fill in ((color, FACE if order == 0 else SIDES[order - 1]), (cover, 255)):
                    if self.camera.distortion:  # sides are bent, and may bend inwards
                        cv.fillPoly(canvas, [points], fill, cv.LINE_8, _SUBPIXEL_BITS)
                    else:
                        cv.fillConvexPoly(canvas, points, fill, cv.LINE_8, _SUBPIXEL_BITS)
                if order == 0 and self.printed is not None:
                    self._print(color, points, ring, np.s_[top:bottom, left:right])
        size = (right - left, bottom - top)
        share = cv.resize(cover, size, interpolation=cv.INTER_AREA)[:, :, None] / 255.0
        part = image[top:bottom, left:right]
        part[:] = np.round(part * (1.0 - share) + cv.resize(color, size, interpolation=cv.INTER_AREA))

    def _print(self, color: Image, outline: Array, corners: Array, window: tuple[slice, slice]) -> None:
        """Draw what is printed on the seen face, within its outline."""
        assert self.printed is not None
        cv = self._opencv
        directions = cv.resize(self._directions[window], color.shape[1::-1], interpolation=cv.INTER_LINEAR)
        face = np.zeros(color.shape[:2], dtype=np.uint8)
        cv.fillPoly(face, [outline], 255, cv.LINE_8, _SUBPIXEL_BITS)
        inside = face > 0
        color[inside] = self.printed.shades(directions, corners)[inside][:, None]

    def corners(self, placement: pin.SE3) -> Array:
        """Return the box's corners in the camera's frame, shape (8, 3) [m]; the first four are of the seen face."""
        in_world = (_CORNERS * self.scene.size) @ self.scene.rotation.T + self.scene.position
        corners: Array = (in_world - placement.translation) @ placement.rotation
        return corners

    def _ring(self, corners: Array) -> Array:
        """Return points along the sides of a face, so many that a lens may bend them, shape (N, 3) [m]."""
        if not self.camera.distortion:
            return corners
        shares = np.linspace(0.0, 1.0, _SIDE_POINTS, endpoint=False)[None, :, None]
        along: Array = corners[:, None] * (1.0 - shares) + np.roll(corners, -1, axis=0)[:, None] * shares
        return along.reshape(-1, 3)

    def _project(self, points: Array) -> Array:
        """Return columns and rows of points in the camera's frame, shape (N, 2) [pixels]."""
        return self.camera.to_image(self.camera.focal_length * points[:, :2] / points[:, 2:])
