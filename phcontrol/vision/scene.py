"""What there is to see: the source of true features in a simulation or a certificate."""

from __future__ import annotations

from typing import Protocol

from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState


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
