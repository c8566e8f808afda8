"""A camera beside a control loop: at its own rate, late, and predicted in between."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.vision.interaction import back_project, project
from phcontrol.vision.pinhole_camera import PinholeCamera


class SeenFrame(NamedTuple):
    """What was found in one image.

    Example:
        >>> from phcontrol import SeenFrame
        >>> SeenFrame(taken=0.1, features=None).features is None  # an image in which the object was not found
        True
    """

    taken: float
    """When the image was taken, on the loop's clock [s]."""
    features: Array | None
    """(μ, ν, l), shape (3,) [m]; None where the object was not found."""


class FrameSource(Protocol):
    """Where frames come from: a :class:`CameraThread`, a :class:`SimulatedCamera`, or one's own."""

    def frames(self) -> list[SeenFrame]:
        """Return what has arrived since the last call, oldest first; may not block."""
        ...


class LoopCamera:
    """Makes image features for every period of a control loop from the frames of a camera in the hand.

    A frame tells where the object was seen from where the hand was when it was taken, which is kept for ``memory``;
    that point in space, at rest, is projected from where the hand is now. No new frame that shows the object for
    ``patience``: NaN is measured, on which a law stops or holds. Frames from the future, older than the memory, or
    older than the newest are not used; ``counts`` says how many.

    Args:
        source: of the frames.
        camera: mounted on the arm.
        robot: the arm.
        object_length: L [m].
        patience: how old the newest frame that shows the object may be [s].
        memory: for how long it is known where the hand was [s].

    Example:
        >>> import numpy as np
        >>> from phcontrol import LoopCamera, PinholeCamera, SeenFrame, load_robot
        >>> class Still:  # one frame, taken at 0 s
        ...     waiting = [SeenFrame(0.0, np.array([0.001, 0.0, 0.0025]))]
        ...     def frames(self):
        ...         found, self.waiting = self.waiting, []
        ...         return found
        >>> robot = load_robot("pera")
        >>> camera = LoopCamera(Still(), PinholeCamera(), robot, object_length=0.04)
        >>> camera.features(0.0, robot.home).round(6), camera.features(0.5, robot.home)  # then seen too long ago
        (array([0.001 , 0.    , 0.0025]), array([nan, nan, nan]))
    """

    def __init__(
        self,
        source: FrameSource,
        camera: PinholeCamera,
        robot: Robot,
        object_length: float,
        *,
        patience: float = 0.3,
        memory: float = 1.0,
    ) -> None:
        if not callable(getattr(source, "frames", None)):
            raise InvalidArgumentError("source", f"must have frames(), but is {type(source).__name__}")
        self.source, self.camera, self._robot = source, camera.mounted_on(robot), robot
        self.object_length = positive("object_length", object_length)
        self.patience, self.memory = positive("patience", patience), positive("memory", memory)
        self._data = robot.model.createData()
        self._frame = robot.frame_id(str(self.camera.frame))
        self._past: deque[tuple[float, pin.SE3]] = deque()
        self._point: Array | None = None
        self._seen = self._newest = -np.inf
        self.counts = {"frames": 0, "seen": 0, "not used": 0}
        """Frames that came, that showed the object, and that came too late or out of order."""

    def features(self, now: float, position: Array) -> Array:
        """Return (μ, ν, l) for now, shape (3,) [m]; NaN when the object is not seen.

        Args:
            now: time of the reading, on the loop's clock [s].
            position: q of the reading [rad].
        """
        here = self._placement(position)
        self._past.append((now, here))
        while self._past[0][0] < now - self.memory:
            self._past.popleft()
        for frame in self.source.frames():
            self._take(frame, now)
        if self._point is None or now - self._seen > self.patience:
            return np.full(3, np.nan)
        return project(here.actInv(self._point), self.camera.focal_length, self.object_length)

    def _take(self, frame: SeenFrame, now: float) -> None:
        self.counts["frames"] += 1
        if not max(self._newest, self._past[0][0] - 1e-9) < frame.taken <= now + 1e-9:
            self.counts["not used"] += 1
            return
        self._newest = frame.taken
        if frame.features is None or not self.camera.sees(frame.features):
            return
        self.counts["seen"] += 1
        seen = back_project(frame.features, self.camera.focal_length, self.object_length)
        self._point, self._seen = self._placement_at(frame.taken).act(seen), frame.taken

    def _placement(self, position: Array) -> pin.SE3:
        robot = self._robot
        pin.forwardKinematics(robot.model, self._data, robot.full_position(position))
        return pin.SE3(pin.updateFramePlacement(robot.model, self._data, self._frame))

    def _placement_at(self, time: float) -> pin.SE3:
        """Return where the camera was, between the two readings about a time."""
        later = next((k for k, (instant, _) in enumerate(self._past) if instant >= time), len(self._past) - 1)
        (before, first), (after, last) = self._past[max(0, later - 1)], self._past[later]
        if after <= before:
            return last
        return pin.SE3.Interpolate(first, last, float(np.clip((time - before) / (after - before), 0.0, 1.0)))
