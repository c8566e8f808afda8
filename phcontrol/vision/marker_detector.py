"""Finding an AprilTag or ArUco marker in an image (needs OpenCV)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, choice, count, positive
from phcontrol.vision.extraction import check_image
from phcontrol.vision.interaction import project
from phcontrol.vision.opencv import load_opencv
from phcontrol.vision.pinhole_camera import PinholeCamera
from phcontrol.vision.rendering import Image

# corners as detectors give them, clockwise in the image, in units of half a side
_CORNERS = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])


_THRESHOLD = 10.0
"""Of 255: with OpenCV's 7 a marker with a narrow rim, seen aslant, is found in 11 of 40 noisy images; so in all."""


class MarkerDetector:
    """Finds one square marker, and where it is: features do not suffer from how the marker is tilted.

    Its frame is in its middle: x right and y down as one reads it, z into it, so that it equals the camera's frame
    up to a shift when it is held before it.

    Args:
        side: length of its black square's edge [m].
        identity: its number.
        dictionary: the family it is of, as OpenCV calls it: "APRILTAG_36h11", "4X4_50", "ARUCO_ORIGINAL", ...
        largest_error: of its corners, from where the pose found has them [pixels]; a marker that is further off is
            none.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MarkerDetector, MarkerPrint, MechanicalSystem, ObservedObject, PinholeCamera
        >>> from phcontrol import RenderedView, Renderer, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.home)
        >>> camera = PinholeCamera(image_size=(320, 240), field_of_view=1.2).mounted_on(system.robot)
        >>> tag = MarkerDetector(side=0.03, identity=7)  # [m]
        >>> thing = ObservedObject.seen_as(camera, [0.001, 0.0, 0.0025], x, (0.04, 0.04, 0.01))
        >>> view = RenderedView(Renderer(thing, printed=MarkerPrint(tag)), tag)
        >>> seen = view(x.placement(camera.frame), np.random.default_rng(0))
        >>> bool(np.abs(seen[:2] - [0.001, 0.0]).max() < camera.pixel_size)
        True
    """

    def __init__(
        self, side: float, identity: int = 0, *, dictionary: str = "APRILTAG_36h11", largest_error: float = 2.0
    ) -> None:
        self.length = positive("side", side)
        self.largest_error = positive("largest_error", largest_error)
        aruco: Any = load_opencv().aruco
        known = sorted(name.removeprefix("DICT_") for name in dir(aruco) if name.startswith("DICT_"))
        self.dictionary = choice("dictionary", dictionary, known)
        family = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{dictionary}"))
        self.identity = count("identity", identity, minimum=0)
        choice("identity", str(identity), [str(number) for number in range(family.bytesList.shape[0])])
        parameters = aruco.DetectorParameters()
        parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
        parameters.adaptiveThreshConstant = _THRESHOLD
        self._detector = aruco.ArucoDetector(family, parameters)

    def __call__(self, image: Image, camera: PinholeCamera) -> Array | None:
        """Return (μ, ν, l) of the marker's middle and side, shape (3,) [m]; None when it is not wholly seen."""
        pose = self.pose(image, camera)
        if pose is None:
            return None
        return project(np.array(pose.translation), camera.focal_length, self.length)

    def pose(self, image: Image, camera: PinholeCamera) -> pin.SE3 | None:
        """Return where the marker is in the camera's frame [m]; None when it is not wholly seen, or seen twice."""
        check_image(image, camera)
        cv = load_opencv()
        corners, identities, _ = self._detector.detectMarkers(image)
        found = np.flatnonzero(np.ravel([] if identities is None else identities) == self.identity)
        if len(found) != 1:
            return None
        shown = np.asarray(corners[int(found[0])], dtype=float).reshape(4, 2)
        plane = camera.from_image(shown) / camera.focal_length
        if not np.isfinite(plane).all():
            return None
        points = 0.5 * self.length * _CORNERS
        # in OpenCV's own order: of a square with y up
        square = points * np.array([1.0, -1.0, 1.0])
        good, turn, shift = cv.solvePnP(square, plane, np.eye(3), None, flags=cv.SOLVEPNP_IPPE_SQUARE)
        if not good or not np.isfinite(turn).all() or not float(shift[2, 0]) > 0.0:
            return None
        rotation = cv.Rodrigues(turn)[0] @ np.diag([1.0, -1.0, -1.0])  # y down, z into the marker
        pose = pin.SE3(rotation, shift.ravel())
        seen = points @ rotation.T + shift.ravel()
        if (seen[:, 2] <= 0.0).any():
            return None
        again = camera.to_image(camera.focal_length * seen[:, :2] / seen[:, 2:])
        return pose if np.abs(again - shown).max() <= self.largest_error else None
