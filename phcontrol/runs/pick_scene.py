"""What there is to pick, and the camera that sees it."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, choice
from phcontrol.mechanics.state import MechanicalState
from phcontrol.vision.interaction import back_project
from phcontrol.vision.marker_detector import MarkerDetector
from phcontrol.vision.marker_print import MarkerPrint
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera
from phcontrol.vision.rendered_view import RenderedView
from phcontrol.vision.rendering import Renderer

SIZE = (0.05, 0.03, 0.03)
"""Of the object, a block of foam [m]."""
MARKER = 0.026
"""Side of the marker on it [m]."""
FEATURES = ("marker", "colour")
"""By what the object may be found."""
WATCHED = ("look", "reach", "servo")
"""Phases in which the arm goes by what it sees."""
SIDEWAYS, UP_AND_DOWN, DEPTH, TURN, TILT = 0.35, (-0.35, 0.15), (0.2, 0.32), 0.6, 0.15
"""From where objects are drawn: tangents of the angles off the optical axis, depth [m], and angles [rad]."""


def pick_camera() -> PinholeCamera:
    """Return a camera with a wide lens that bends the image, and an axis that is not in its middle."""
    matrix = [[322.4, 0.0, 316.2], [0.0, 321.1, 243.7], [0.0, 0.0, 1.0]]
    return PinholeCamera.calibrated(matrix, (-0.11, 0.02, 4e-4, -3e-4, -0.002), (640, 480))


def random_object(
    camera: PinholeCamera, x: MechanicalState, generator: np.random.Generator, features: str = FEATURES[0]
) -> ObservedObject:
    """Return the block at a random pose in view of the camera at a state: place, turn about the line of sight, tilt."""
    depth = generator.uniform(*DEPTH)
    f = camera.focal_length
    seen = np.array(
        [f * generator.uniform(-SIDEWAYS, SIDEWAYS), f * generator.uniform(*UP_AND_DOWN), f * SIZE[0] / depth]
    )
    placement = x.placement(str(camera.frame))
    tilt = generator.uniform(-TILT, TILT, 2)
    turn = 0.5 * math.pi + generator.uniform(-TURN, TURN)
    rotation = placement.rotation @ pin.rpy.rpyToMatrix(tilt[0], tilt[1], 0.0) @ pin.utils.rotate("z", turn)
    return ObservedObject(
        camera, placement.act(back_project(seen, f, SIZE[0])), SIZE, rotation, length=length_of(features)
    )


def length_of(features: str) -> float:
    """Return L of what is looked at: the marker's side, or the block's length [m]."""
    return MARKER if choice("features", features, FEATURES) == "marker" else SIZE[0]


class WatchedView(RenderedView):
    """A rendered view that remembers in which images the object was wholly seen.

    Args:
        thing: what is looked at.
        features: "marker" for a block with a marker on its face, "colour" for an orange one.
    """

    def __init__(self, thing: ObservedObject, features: str) -> None:
        if choice("features", features, FEATURES) == "marker":
            detector = MarkerDetector(MARKER, dictionary="4X4_50")
            super().__init__(Renderer(thing, grey_noise=2.0, blur=0.6, printed=MarkerPrint(detector)), detector)
        else:
            super().__init__(Renderer(thing, grey_noise=2.0))
        self.seen: list[bool] = []
        """For each image, in the order they were taken."""

    def __call__(self, placement: pin.SE3, generator: np.random.Generator) -> Array | None:
        """Return (μ, ν, l), shape (3,) [m], or None when no object is found."""
        features = super().__call__(placement, generator)
        self.seen.append(features is not None)
        return features
