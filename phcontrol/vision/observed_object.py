"""An object at rest in the world, as a camera in the hand sees it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, number, positive, vector
from phcontrol._validation import rotation as check_rotation
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.vision.interaction import back_project, project
from phcontrol.vision.pinhole_camera import PinholeCamera

_NO_STATE: Array = np.zeros(0)


class ObservedObject:
    """A box at rest; its features (5.1) follow from where it is and where the arm holds the camera.

    ``position`` is the centre of the face that is looked at, L its longer side, so that l = fL/Z is exact for a
    face parallel to the image; images (:class:`phcontrol.vision.rendering.Renderer`) also show its tilt.

    Args:
        camera: what sees it.
        position: centre of the seen face in the world, (3,) [m].
        size: length L, width and height (depth behind the seen face) [m].
        rotation: (3, 3), axes of the box in the world: x along the length, y along the width, z into the box.
            Without effect on the features.
        length: L of what is looked for on it, a marker's side for instance [m]; by default the face's longer side.

    Example:
        >>> from phcontrol import MechanicalSystem, ObservedObject, PinholeCamera, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.home)
        >>> thing = ObservedObject.seen_as(PinholeCamera(), [0.003, 0.002, 0.0028], x)  # (μ, ν, l) [m]
        >>> thing.features(x).round(6)
        array([0.003 , 0.002 , 0.0028])
    """

    state_size = 0

    def __init__(
        self,
        camera: PinholeCamera,
        position: ArrayLike,
        size: ArrayLike = (0.038, 0.0072, 0.010),
        rotation: ArrayLike | None = None,
        *,
        length: float | None = None,
    ) -> None:
        self.camera = camera
        self.position = vector("position", position, 3)
        self.size = vector("size", size, 3)
        for side in self.size:
            positive("size", side)
        self.length = float(self.size[0]) if length is None else positive("length", length)
        self.rotation = np.eye(3) if rotation is None else check_rotation("rotation", rotation)

    @classmethod
    def seen_as(
        cls,
        camera: PinholeCamera,
        features: ArrayLike,
        x: MechanicalState,
        size: ArrayLike = (0.038, 0.0072, 0.010),
        turn: float = 0.0,
    ) -> ObservedObject:
        """Return the object that a camera would see with these features (μ, ν, l) [m] from a state of the arm.

        It faces the camera, its length turned from the image's x axis by ``turn`` [rad].
        """
        camera = camera.mounted_on(x.system.robot)
        placement = x.placement(str(camera.frame))
        length = float(vector("size", size, 3)[0])
        seen = vector("features", features, 3)
        if seen[2] == 0.0:
            raise InvalidArgumentError("features", f"must have a length l other than 0, but are {seen}")
        point = back_project(seen, camera.focal_length, length)
        rotation = placement.rotation @ pin.utils.rotate("z", number("turn", turn))
        return cls(camera, placement.act(point), size, rotation)

    def record(self) -> dict[str, Any]:
        """Return where it is and how large, for JSON."""
        return {
            "position": self.position.tolist(),
            "rotation": self.rotation.tolist(),
            "size": self.size.tolist(),
        }

    def initial_state(self) -> Array:
        """Return nothing: the object has no state."""
        return _NO_STATE

    def rate(self, x: MechanicalState, state: Array) -> Array:
        """Return nothing."""
        return _NO_STATE

    def features(self, x: MechanicalState, state: Array = _NO_STATE) -> Array:
        """Return (μ, ν, l) at a state of the arm, shape (3,) [m]; l < 0 for an object behind the camera."""
        frame = self.camera.frame or self.camera.mounted_on(x.system.robot).frame
        return self.features_from(x.placement(str(frame)))

    def features_from(self, placement: pin.SE3) -> Array:
        """Return (μ, ν, l) for a pose of the camera in the world, shape (3,) [m]."""
        point = placement.rotation.T @ (self.position - placement.translation)
        return project(point, self.camera.focal_length, self.length)
