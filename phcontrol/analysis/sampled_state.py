"""A state at which a law is looked at."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array
from phcontrol.vision.scene import Scene


class SampledState(NamedTuple):
    """A state of plant, controller and surroundings, and from which stratum it was drawn."""

    time: float
    position: Array
    velocity: Array
    state: Array
    force: Array
    scene: Scene | None
    stratum: str
