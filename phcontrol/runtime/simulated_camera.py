"""A camera in the hand of a simulated arm."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import number, positive
from phcontrol.runtime.control_box import ControlBox
from phcontrol.runtime.loop_camera import SeenFrame
from phcontrol.sensors.camera_sensor import FeatureSource
from phcontrol.vision.pinhole_camera import PinholeCamera


class SimulatedCamera:
    """Takes frames from where the camera of a :class:`ControlBox` truly is; each arrives ``latency`` later.

    Time is the box's.

    Args:
        box: the arm.
        camera: mounted on it.
        view: makes features of a camera pose, as :class:`RenderedView` does from pixels.
        rate: frames in a second [1/s].
        latency: [s]; by default one frame.
        seed: of the view's noise.

    Example:
        >>> from phcontrol import ControlBox, MechanicalSystem, ObservedObject, PinholeCamera, RenderedView
        >>> from phcontrol import Renderer, SimulatedCamera, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> camera = PinholeCamera(image_size=(320, 240), field_of_view=1.2).mounted_on(system.robot)
        >>> thing = ObservedObject.seen_as(camera, [0.001, 0.001, 0.0025], system.at(system.robot.home))
        >>> frames = SimulatedCamera(ControlBox(system), camera, RenderedView(Renderer(thing)), latency=0.0).frames()
        >>> len(frames), frames[0].taken
        (1, 0.0)
    """

    def __init__(
        self,
        box: ControlBox,
        camera: PinholeCamera,
        view: FeatureSource,
        *,
        rate: float = 30.0,
        latency: float | None = None,
        seed: int = 0,
    ) -> None:
        self._box, self._view, self._frame = box, view, str(camera.mounted_on(box.system.robot).frame)
        self.rate = positive("rate", rate)
        self.latency = 1.0 / self.rate if latency is None else number("latency", latency, minimum=0.0)
        self._noise = np.random.default_rng(seed)
        self._taken = 0
        self._pending: list[SeenFrame] = []

    def frames(self) -> list[SeenFrame]:
        """Take a frame if it is time, and return those that have arrived."""
        now = self._box.time
        if now >= self._taken / self.rate - 1e-9:
            placement = self._box.system.robot.placement(self._frame, self._box.reading().position)
            self._pending.append(SeenFrame(now, self._view(placement, self._noise)))
            self._taken += 1
        arrived = [frame for frame in self._pending if frame.taken + self.latency <= now + 1e-9]
        self._pending = self._pending[len(arrived) :]
        return arrived
