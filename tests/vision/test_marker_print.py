"""A printed marker, cell by cell."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phcontrol import MarkerDetector
from phcontrol.vision.marker_print import MarkerPrint
from tests.vision.markers import CELLS, picture_of

SIDE, FACE = 0.04, 0.07  # [m]


def test_each_cell_is_where_it_should_be_on_white_seen_aslant():
    """Lines of sight to the middle of each cell, and of a rim of two cells about the marker."""
    picture, cells = picture_of("APRILTAG_36h11", 7)
    expected = np.pad(picture[CELLS // 2 :: CELLS, CELLS // 2 :: CELLS], 1, constant_values=255)
    place = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.4, 0.7), np.array([0.03, -0.02, 0.3]))
    middles = SIDE / cells * (np.arange(cells + 4) - 0.5 * (cells + 3))
    points = np.stack([*np.meshgrid(middles, middles), np.zeros((cells + 4, cells + 4))], axis=-1)
    seen = points @ place.rotation.T + place.translation
    square = 0.5 * FACE * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    face = square @ place.rotation.T + place.translation
    shades = MarkerPrint(MarkerDetector(SIDE, 7)).shades(seen[..., :2] / seen[..., 2:], face)
    np.testing.assert_array_equal(shades, expected)
