"""What a controller orders."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array


class Command(NamedTuple):
    """What a controller orders: a torque and the rate of its own state."""

    torque: Array
    """u, shape (n,) [N·m]."""
    state_rate: Array
    """Rate of the controller's state, same shape as the state."""
