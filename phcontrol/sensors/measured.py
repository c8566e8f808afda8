"""The measurements beside joint positions and velocities that a controller may need."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array


class Measured(NamedTuple):
    """What sensors show a controller at one instant. What was not measured is None."""

    external_force: Array | None = None
    """f_e, shape (n,): generalised force of the environment on the joints [N·m]."""


NOTHING = Measured()
"""No measurement at all."""
