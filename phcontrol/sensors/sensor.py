"""What a sensor is: it is updated at fixed instants, and shows its reading in between."""

from __future__ import annotations

from typing import Any, Protocol

from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState


class Sensor(Protocol):
    """A sensor without hidden state: its state is made by ``start``, returned by ``update`` and kept by the loop.

    One that computes with q and q̇ as they are measured, and not as they are, has a true ``reads_joints``: where a run
    has a :class:`JointSensor`, it is given what that shows.
    """

    quantity: str
    """The field of Measured that it fills."""
    period: float | None
    """Time between updates [s]; None for every step of the loop."""

    def start(self, x: MechanicalState, external_force: Array) -> Any:
        """Return the state to start with, at time 0."""
        ...

    def update(self, state: Any, t: float, x: MechanicalState, external_force: Array, torque: Array) -> Any:
        """Return the state after an instant t [s].

        ``external_force`` is the true f_e, for sensors that feel it; ``torque`` is what the motors have
        applied since the last update, for observers.
        """
        ...

    def reading(self, state: Any) -> Array:
        """Return what the sensor shows, shape (n,)."""
        ...
