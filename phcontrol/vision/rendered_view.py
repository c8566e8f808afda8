"""Features from the pixels of rendered images (needs OpenCV)."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.vision.extraction import extract_features
from phcontrol.vision.rendering import Renderer


class RenderedView:
    """Renders an image from a pose of the camera and finds the object in it: a source for ``CameraSensor``.

    Args:
        renderer: draws the images.
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer

    def __call__(self, placement: pin.SE3, generator: np.random.Generator) -> Array | None:
        """Return (μ, ν, l), shape (3,) [m], or None when no object is found."""
        return extract_features(self.renderer.render(placement, generator), self.renderer.camera)
