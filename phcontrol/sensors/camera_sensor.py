"""A camera in the hand that shows image features at frame rate, and predicts them in between."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, number, positive
from phcontrol.mechanics.state import MechanicalState
from phcontrol.vision.interaction import back_project, project
from phcontrol.vision.observed_object import ObservedObject

FeatureSource = Callable[[pin.SE3, np.random.Generator], "Array | None"]
"""Gives the features (μ, ν, l) [m] seen from a pose of the camera, or None when no object is found."""

_NOT_SEEN: Array = np.full(3, np.nan)
_NOT_SEEN.flags.writeable = False


@dataclass(frozen=True)
class _Frame:
    """A frame on its way: when it will be there, and from where it was taken when."""

    ready: float
    taken: float
    placement: pin.SE3
    features: Array | None


@dataclass(frozen=True)
class _State:
    frames_taken: int
    pending: tuple[_Frame, ...]
    point: Array | None
    """Where the object is in the world, after the newest frame that shows it [m]."""
    seen: float
    """When that frame was taken [s]."""
    shown: Array
    noise: np.random.Generator


class CameraSensor:
    """Shows the image features of an object: measured at frame rate, some time late, and predicted in between.

    Between two frames, and over the latency, the features go on as τ̇ = Δ̄q̇ says, from the measured joint positions.
    For an object at rest this has a closed form, which is used: the features of the newest frame give a point in
    space (with the object's known length), and that point is projected from where the camera is now.

    When no object is found in a frame the prediction goes on for ``patience``, and then NaN is shown, on which a
    law stops or holds.

    Args:
        scene: the object and the camera that sees it.
        rate: frames in a second [Hz]; a frame is taken at the first step at or after its time.
        latency: time from taking a frame to its features [s]; by default one frame. The frame at the start is there
            at once (the arm was at rest before, and had been seen).
        source: makes features of a camera pose, as :class:`RenderedView` does from pixels; by default
            the true ones, with noise.
        noise: standard deviation of the default source: of μ, ν and l [m].
        patience: how long to go on without a frame that shows the object [s].
        seed: of the noise.

    Example:
        >>> from phcontrol import CameraSensor, MechanicalSystem, ObservedObject, PinholeCamera, load_robot
        >>> from phcontrol import make_controller, simulate
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> camera = PinholeCamera()
        >>> thing = ObservedObject.seen_as(camera, [0.003, 0.002, 0.0028], system.at(system.robot.home))
        >>> servo = make_controller("hamiltonian_servo", system, goal=[0.0, 0.0, 0.002], camera=camera)
        >>> sensor = CameraSensor(thing, rate=30.0)  # frames a second, each one late
        >>> log = simulate(system, servo, duration=0.1, dt=2e-3, scene=thing, sensors=[sensor])
        >>> log.features[-1].round(4), log.measured["features"].shape
        (array([0.0025, 0.0018, 0.0027]), (51, 3))
    """

    quantity = "features"
    period: float | None = None

    def __init__(
        self,
        scene: ObservedObject,
        *,
        rate: float = 30.0,
        latency: float | None = None,
        source: FeatureSource | None = None,
        noise: float = 0.0,
        patience: float = 0.3,
        seed: int = 0,
    ) -> None:
        self.scene = scene
        self.rate = positive("rate", rate)
        self.latency = 1.0 / self.rate if latency is None else number("latency", latency, minimum=0.0)
        self.noise = number("noise", noise, minimum=0.0)
        self.source = self._true_features if source is None else source
        self.patience = number("patience", patience, minimum=0.0)
        self.seed = seed

    def start(self, x: MechanicalState, external_force: Array) -> Any:
        """Return the state after the first frame, which is there at once."""
        generator, placement = np.random.default_rng(self.seed), self._placement(x)
        frame = _Frame(0.0, 0.0, placement, self.source(placement, generator))
        return self._show(_State(1, (frame,), None, -np.inf, _NOT_SEEN, generator), 0.0, placement)

    def update(self, state: Any, t: float, x: MechanicalState, external_force: Array, torque: Array) -> Any:
        """Take a frame if it is time, take in what has arrived, and predict the features for now."""
        placement = self._placement(x)
        if t >= state.frames_taken / self.rate - 1e-9:
            frame = _Frame(t + self.latency, t, placement, self.source(placement, state.noise))
            state = _State(
                state.frames_taken + 1, (*state.pending, frame), state.point, state.seen, state.shown, state.noise
            )
        return self._show(state, t, placement)

    def reading(self, state: Any) -> Array:
        """Return the features for now, shape (3,) [m]; NaN when the object has been lost."""
        shown: Array = state.shown
        return shown

    def _placement(self, x: MechanicalState) -> pin.SE3:
        frame = self.scene.camera.frame or self.scene.camera.mounted_on(x.system.robot).frame
        return x.placement(str(frame))

    def _show(self, state: _State, t: float, placement: pin.SE3) -> _State:
        camera, length = self.scene.camera, self.scene.length
        point, seen = state.point, state.seen
        pending = state.pending
        while pending and pending[0].ready <= t + 1e-9:
            frame, pending = pending[0], pending[1:]
            if frame.features is not None:
                point = frame.placement.act(back_project(frame.features, camera.focal_length, length))
                seen = frame.taken
        shown = _NOT_SEEN
        if point is not None and t - seen <= self.latency + self.patience + 1.0 / self.rate:
            shown = project(placement.actInv(point), camera.focal_length, length)
        return _State(state.frames_taken, pending, point, seen, shown, state.noise)

    def _true_features(self, placement: pin.SE3, generator: np.random.Generator) -> Array | None:
        features = self.scene.features_from(placement)
        if not self.scene.camera.sees(features):
            return None
        return features + self.noise * generator.standard_normal(3) if self.noise else features
