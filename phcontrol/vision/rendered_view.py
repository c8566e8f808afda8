"""Features from the pixels of rendered images (needs OpenCV)."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.vision.extraction import Detector, extract_features
from phcontrol.vision.rendering import Renderer


class RenderedView:
    """Renders an image from a pose of the camera and finds the object in it: a source for ``CameraSensor``.

    Args:
        renderer: draws the images.
        detector: finds the object in them; by default by its colour, orange.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, ObservedObject, PinholeCamera, RenderedView, Renderer
        >>> from phcontrol import load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.home)
        >>> camera = PinholeCamera(image_size=(320, 240), field_of_view=1.2).mounted_on(system.robot)
        >>> thing = ObservedObject.seen_as(camera, [0.001, 0.0, 0.0025], x)
        >>> seen = RenderedView(Renderer(thing))(x.placement(camera.frame), np.random.default_rng(0))
        >>> bool(np.abs(seen - thing.features(x)).max() < camera.pixel_size)
        True
    """

    def __init__(self, renderer: Renderer, detector: Detector = extract_features) -> None:
        self.renderer, self.detector = renderer, detector

    def __call__(self, placement: pin.SE3, generator: np.random.Generator) -> Array | None:
        """Return (μ, ν, l), shape (3,) [m], or None when no object is found."""
        return self.detector(self.renderer.render(placement, generator), self.renderer.camera)
