"""Finding the object in an image (needs OpenCV)."""

from __future__ import annotations

import math

import numpy as np

from phcontrol._validation import Array
from phcontrol.vision.opencv import load_opencv
from phcontrol.vision.pinhole_camera import PinholeCamera
from phcontrol.vision.rendering import Image

HUES = (2, 20)
"""Range of the object's colour, orange, as OpenCV's hue (0 to 180)."""
LEAST_SATURATION, LEAST_VALUE = 140, 60
"""From which a pixel counts as coloured (of 255); half way between the object and a grey ground."""
LEAST_AREA = 40
"""From which a spot counts as the object [pixels]."""


def extract_features(image: Image, camera: PinholeCamera) -> Array | None:
    """Return (μ, ν, l), shape (3,) [m], of the orange object in an image; None if it is not wholly seen.

    The largest orange spot is taken for the object. Its centre is the mean of its pixels, each weighed by how much of
    it is covered; its length follows from their second moments, l = √(12 λ) with λ the larger variance, as of a
    filled rectangle: below a pixel exact, and independent of how it is turned in the image. A spot that touches the
    image's border is not wholly seen.
    """
    cv = load_opencv()
    hsv = cv.cvtColor(image, cv.COLOR_BGR2HSV)
    mask = cv.inRange(hsv, (HUES[0], LEAST_SATURATION, LEAST_VALUE), (HUES[1], 255, 255))
    mask = cv.morphologyEx(mask, cv.MORPH_OPEN, np.ones((3, 3), dtype=np.uint8))
    spots, labels, statistics, _ = cv.connectedComponentsWithStats(mask, connectivity=4)
    if spots < 2:
        return None
    largest = 1 + int(np.argmax(statistics[1:, cv.CC_STAT_AREA]))
    left, top, width, height, area = (int(value) for value in statistics[largest])
    if area < LEAST_AREA or left == 0 or top == 0:
        return None
    if left + width == image.shape[1] or top + height == image.shape[0]:
        return None
    # how much of a pixel is covered, at the border a part: by red less blue, which a grey ground has none of
    window = np.s_[max(0, top - 2) : top + height + 2, max(0, left - 2) : left + width + 2]
    spot = (labels[window] == largest).astype(np.uint8)
    redness = cv.subtract(image[window][:, :, 2], image[window][:, :, 0])
    full = float(np.median(redness[spot > 0]))
    near = cv.dilate(spot, np.ones((5, 5), dtype=np.uint8))
    moments = cv.moments(np.minimum(redness / full, 1.0) * near)
    total = moments["m00"]
    middle = 0.5 * (moments["mu20"] + moments["mu02"]) / total
    half = math.hypot(0.5 * (moments["mu20"] - moments["mu02"]) / total, moments["mu11"] / total)
    length = math.sqrt(12.0 * (middle + half))
    column, row = window[1].start + moments["m10"] / total, window[0].start + moments["m01"] / total
    return camera.from_pixels([column, row, length])
