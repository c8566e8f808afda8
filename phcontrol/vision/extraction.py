"""Finding an object in an image by its colour (needs OpenCV)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from phcontrol._validation import Array, count, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.vision.opencv import load_opencv
from phcontrol.vision.pinhole_camera import PinholeCamera
from phcontrol.vision.rendering import Image

HUES = (2, 20)
"""Range of the rendered object's colour, orange, as OpenCV's hue (0 to 180)."""
LEAST_SATURATION, LEAST_VALUE = 140, 60
"""From which a pixel counts as coloured (of 255); half way between the rendered object and a grey ground."""
LEAST_AREA = 40
"""From which a spot counts as the object [pixels]."""

_OPENING = np.ones((3, 3), dtype=np.uint8)

Detector = Callable[[Image, PinholeCamera], "Array | None"]
"""Finds the object in an image: its features (μ, ν, l), shape (3,) [m], or None when it is not wholly seen.

:class:`ColourDetector`, :class:`MarkerDetector`, or any function of one's own.
"""


class ColourDetector:
    """Finds the largest spot of a colour.

    Its centre is the mean of its pixels, each weighed by how much of it is covered and by the area it stands for on
    the image plane; its length follows from their second moments, l = √(12 λ) with λ the larger variance, as of a
    filled rectangle: below a pixel exact, and independent of how it is turned in the image. A spot that touches the
    image's border is not wholly seen.

    How much a pixel is covered is read from its colour's strongest channel less its weakest: of a grey ground 0.

    Args:
        hues: range of the colour, as OpenCV's hue (0 to 180); the first may be the larger, for red, about 0.
        least_saturation: from which a pixel counts as coloured (of 255); half way between object and ground.
        least_value: likewise, of its brightness.
        least_area: from which a spot counts as the object [pixels].

    Example:
        >>> import numpy as np
        >>> from phcontrol import ColourDetector, PinholeCamera
        >>> camera = PinholeCamera(image_size=(64, 48), field_of_view=1.0)
        >>> image = np.zeros((48, 64, 3), np.uint8)
        >>> image[20:28, 30:40] = (0, 120, 255)  # blue, green, red: an orange spot
        >>> camera.to_pixels(ColourDetector()(image, camera)).round(1)  # column, row, length
        array([34.5, 23.5,  9.9])
    """

    def __init__(
        self,
        hues: Sequence[float] = HUES,
        *,
        least_saturation: float = LEAST_SATURATION,
        least_value: float = LEAST_VALUE,
        least_area: int = LEAST_AREA,
    ) -> None:
        if len(hues) != 2:
            raise InvalidArgumentError("hues", f"must be (first, last), but is {hues!r}")
        self.hues = tuple(number("hues", hue, minimum=0.0, maximum=180.0) for hue in hues)
        self.least_saturation = number("least_saturation", least_saturation, minimum=1.0, maximum=255.0)
        self.least_value = number("least_value", least_value, minimum=0.0, maximum=255.0)
        self.least_area = count("least_area", least_area)
        first, last = self.hues
        middle = 0.5 * (first + last) if first <= last else (0.5 * (first + last) + 90.0) % 180.0
        # which of blue, green, red is the strongest at that hue, and which the weakest
        self._strong = (2, 1, 0)[int(((middle + 30.0) % 180.0) // 60.0)]
        self._weak = (0, 2, 1)[int((middle % 180.0) // 60.0)]

    def __call__(self, image: Image, camera: PinholeCamera) -> Array | None:
        """Return (μ, ν, l), shape (3,) [m], or None. Raises InvalidArgumentError for an image of another size."""
        check_image(image, camera)
        cv = load_opencv()
        mask = cv.morphologyEx(self._mask(cv.cvtColor(image, cv.COLOR_BGR2HSV)), cv.MORPH_OPEN, _OPENING)
        spots, labels, statistics, _ = cv.connectedComponentsWithStats(mask, connectivity=4)
        if spots < 2:
            return None
        largest = 1 + int(np.argmax(statistics[1:, cv.CC_STAT_AREA]))
        left, top, width, height, area = (int(value) for value in statistics[largest])
        if area < self.least_area or left == 0 or top == 0:
            return None
        if left + width == image.shape[1] or top + height == image.shape[0]:
            return None
        window = np.s_[max(0, top - 2) : top + height + 2, max(0, left - 2) : left + width + 2]
        spot = (labels[window] == largest).astype(np.uint8)
        strength = cv.subtract(image[window][:, :, self._strong], image[window][:, :, self._weak])
        full = float(np.median(strength[spot > 0]))
        near = cv.dilate(spot, np.ones((5, 5), dtype=np.uint8))
        rows, columns = np.nonzero(near)
        pixels: Array = np.stack([columns + float(window[1].start), rows + float(window[0].start)], axis=-1)
        return _moments(pixels, np.minimum(strength[rows, columns] / full, 1.0), camera)

    def _mask(self, hsv: Image) -> Image:
        cv, (first, last) = load_opencv(), self.hues
        ranges = [(first, last)] if first <= last else [(first, 180.0), (0.0, last)]
        found = [
            cv.inRange(hsv, (low, self.least_saturation, self.least_value), (high, 255, 255)) for low, high in ranges
        ]
        mask: Image = np.bitwise_or.reduce(found)
        return mask


def _moments(pixels: Array, cover: Array, camera: PinholeCamera) -> Array | None:
    """Return the features of pixels, shape (N, 2), that are covered by so much, shape (N,)."""
    points = camera.from_image(pixels)
    weights = cover * camera.pixel_areas(points)
    total = float(weights.sum())
    if not 0.0 < total < math.inf:
        return None
    centre = weights @ points / total
    x, y = (points - centre).T
    xx, yy, xy = ((weights * product).sum() / total for product in (x * x, y * y, x * y))
    length = math.sqrt(12.0 * (0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)))
    return np.array([*centre, length])


def check_image(image: Image, camera: PinholeCamera) -> None:
    """Raise InvalidArgumentError unless an image is of a camera's size, with three colours of 8 bits."""
    width, height = camera.image_size or (0, 0)
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.shape != (height, width, 3):
        given = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise InvalidArgumentError("image", f"must be uint8 of shape ({height}, {width}, 3), but is {given}")


_ORANGE = ColourDetector()


def extract_features(image: Image, camera: PinholeCamera) -> Array | None:
    """Return (μ, ν, l), shape (3,) [m], of the orange object in an image: what ``ColourDetector()`` finds.

    Example:
        >>> import numpy as np
        >>> from phcontrol import PinholeCamera, extract_features
        >>> camera = PinholeCamera(image_size=(64, 48), field_of_view=1.0)
        >>> image = np.zeros((48, 64, 3), np.uint8)
        >>> extract_features(image, camera) is None  # nothing orange in it
        True
        >>> image[20:28, 30:40] = (0, 120, 255)
        >>> extract_features(image, camera).shape
        (3,)
    """
    return _ORANGE(image, camera)
