"""A camera that is read in a thread of its own, so that no image keeps a control loop waiting."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from types import TracebackType

from phcontrol.exceptions import PHControlError
from phcontrol.runtime.loop_camera import SeenFrame
from phcontrol.vision.extraction import Detector
from phcontrol.vision.pinhole_camera import PinholeCamera
from phcontrol.vision.rendering import Image

_KEPT = 16  # frames that nobody has asked for yet


class CameraThread:
    """Grabs images and finds the object in them; the newest wait for ``frames``.

        with CameraThread(grab, detector, camera) as frames:
            loop = ControlLoop(..., camera=LoopCamera(frames, camera, robot, length))

    An error in ``grab`` or the detector ends the thread; ``frames`` raises it, on which a control loop stops.

    Args:
        grab: waits for the next image, and returns it with the time it was taken on the loop's clock [s]; None where
            none came in time.
        detector: finds the object.
        camera: what took the images.

    Example:
        >>> import time
        >>> import numpy as np
        >>> from phcontrol import CameraThread, ColourDetector, PinholeCamera
        >>> def grab():  # an image and when it was taken; here a dark one
        ...     time.sleep(0.01)
        ...     return np.zeros((48, 64, 3), np.uint8), 0.0
        >>> camera = PinholeCamera(image_size=(64, 48), field_of_view=1.0)
        >>> with CameraThread(grab, ColourDetector(), camera) as source:
        ...     time.sleep(0.5)
        ...     frames = source.frames()
        >>> len(frames) > 0, frames[0].features is None
        (True, True)
    """

    def __init__(
        self, grab: Callable[[], tuple[Image, float] | None], detector: Detector, camera: PinholeCamera
    ) -> None:
        self._grab, self._detector, self._camera = grab, detector, camera
        self._waiting: deque[SeenFrame] = deque(maxlen=_KEPT)
        self._error: Exception | None = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)

    def __enter__(self) -> CameraThread:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._ending.set()
        self._thread.join(timeout=2.0)

    def frames(self) -> list[SeenFrame]:
        """Return what has arrived since the last call. Raises PHControlError when the thread has ended by an error."""
        if self._error is not None:
            raise PHControlError(
                f"the camera's thread ended: {type(self._error).__name__}: {self._error}"
            ) from self._error
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def _work(self) -> None:
        try:
            while not self._ending.is_set():
                grabbed = self._grab()
                if grabbed is not None:
                    image, taken = grabbed
                    self._waiting.append(SeenFrame(float(taken), self._detector(image, self._camera)))
        except Exception as error:  # whatever a camera's driver or a user's detector raises
            self._error = error
