"""A marker as it is printed on an object, for rendered images (needs OpenCV)."""

from __future__ import annotations

from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.vision.marker_detector import MarkerDetector
from phcontrol.vision.opencv import load_opencv
from phcontrol.vision.rendering import Image

_CELL = 16  # pixels of the print along a cell


class MarkerPrint:
    """The marker that a detector looks for, in the middle of a white face.

    Args:
        detector: says which marker, and how large it is.

    Example:
        >>> from phcontrol import MarkerDetector, MarkerPrint
        >>> tag = MarkerDetector(side=0.03, identity=7)
        >>> printed = MarkerPrint(tag)
        >>> type(printed).__name__
        'MarkerPrint'
    """

    def __init__(self, detector: MarkerDetector) -> None:
        self._opencv: Any = load_opencv()
        aruco = self._opencv.aruco
        family = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{detector.dictionary}"))
        pixels = _CELL * (family.markerSize + 2)
        self._print: Image = aruco.generateImageMarker(family, detector.identity, pixels)
        self._scale = pixels / detector.length

    def shades(self, directions: Array, corners: Array) -> Image:
        """Return how bright a face is along lines of sight, shape (height, width).

        Args:
            directions: (X, Y)/Z of the lines, shape (height, width, 2).
            corners: of the face in the camera's frame, in a ring, the first side along its length, (4, 3) [m].
        """
        centre, along, across = corners.mean(axis=0), corners[1] - corners[0], corners[3] - corners[0]
        along, across = along / np.linalg.norm(along), across / np.linalg.norm(across)
        normal = np.cross(along, across)
        # of X/Z and Y/Z: depth Z = n·c/(n·(x, y, 1)), then the point less the centre, along the face's axes
        x, y = directions[..., 0], directions[..., 1]
        depth = normal.dot(centre) / (normal[0] * x + normal[1] * y + normal[2])
        column, row = (
            self._scale * (depth * (axis[0] * x + axis[1] * y + axis[2]) - axis.dot(centre))
            + 0.5 * len(self._print)
            - 0.5
            for axis in (along, across)
        )
        cv = self._opencv
        maps = (column.astype(np.float32), row.astype(np.float32))
        shades: Image = cv.remap(self._print, *maps, cv.INTER_LINEAR, borderMode=cv.BORDER_CONSTANT, borderValue=255)
        return shades
