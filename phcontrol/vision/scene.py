"""What there is to see: the source of true features in a simulation or a certificate."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState
from phcontrol.vision.pinhole_camera import PinholeCamera


class Scene(Protocol):
    """What a camera looks at. A scene may have a state of its own, which is integrated with the loop."""

    @property
    def state_size(self) -> int:
        """Length of the scene's state; 0 for none."""
        ...

    def initial_state(self) -> Array:
        """Return the state to start with."""
        ...

    def rate(self, x: MechanicalState, state: Array) -> Array:
        """Return the rate of the scene's state."""
        ...

    def features(self, x: MechanicalState, state: Array) -> Array:
        """Return what the camera would show: (μ, ν, l), shape (3,) [m]."""
        ...


class Eyes(Protocol):
    """What a law that steers by a camera is asked beside its torque."""

    @property
    def camera(self) -> PinholeCamera:
        """The camera, mounted on the arm."""
        ...

    @property
    def goal(self) -> Array:
        """The features that are desired, τ_d = (μ, ν, l), shape (3,) [m]."""
        ...

    def random_scene(self, x: MechanicalState, generator: np.random.Generator, spread: float = 1.0) -> Scene:
        """Draw something to see from a state, for checks; with a small ``spread`` close to what the law desires."""
        ...
