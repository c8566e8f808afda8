"""The plant's true motion out of one state, along which promises are differentiated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured

STEP = 2e-4
"""Of the finite differences [s]; shorter where the arm moves fast."""


class Flow:
    """The straight line through one state along the closed loop's true vector field.

    Its derivative at 0 is that of the closed loop: forward dynamics of the plant under the law's torque. The law is
    shown what it says it needs, and nothing else.
    """

    def __init__(self, law: Controller, plant: MechanicalSystem, at: SampledState) -> None:
        self._law, self._plant, self._at = law, plant, at
        self.start = Seen.of(law, plant, at)
        """The law at the state itself."""
        command = self.start.command()
        self._state_rate = command.state_rate
        self._acceleration = plant.at(at.position, at.velocity).acceleration(command.torque, at.force)
        self._unit = STEP / max(1.0, float(np.abs(at.velocity).max()))
        self._switches = law.phases[1:]

    @property
    def rounding(self) -> float:
        """What rounding of a number of size 1 leaves in its rate [1/s]."""
        return float(np.finfo(float).eps) / self._unit

    def seen(self, shift: float) -> Seen:
        """Return the law ``shift`` seconds along the flow, where sensors show the same forces, and objects as then."""
        at = self._at
        moved = at._replace(
            time=at.time + shift,
            position=at.position + shift * at.velocity,
            velocity=at.velocity + shift * self._acceleration,
            state=at.state + shift * self._state_rate,
        )
        return Seen(self._law, moved, self._measured(moved.position))

    def _measured(self, position: Array) -> Measured:
        measured, scene = self.start.measured, self._at.scene
        if scene is None or measured.features is None:
            return measured
        return measured._replace(features=scene.features(self._plant.at(position), scene.initial_state()))

    def followed(self, shift: float) -> Array:
        """Return H_d and the target's coordinates ``shift`` seconds along the flow, in one vector."""
        there = self.seen(shift)
        return np.concatenate([[there.stored()], there.coordinates()])

    def storage(self, shift: float) -> float:
        """Return H_d ``shift`` seconds along the flow [J]."""
        return self.seen(shift).stored()

    def aging(self, stretch: float = 1.0) -> float:
        """Return ∂H_d/∂t at the same coordinates [W], by differences like those of ``derivative``."""
        return self.start.aging(stretch * self._unit)

    def stays(self, stretch: float) -> bool:
        """Return whether differences with that stretch of the step reach across no switch to another law."""
        time, reach = self._at.time, 2.0 * stretch * self._unit
        return not any(time - reach < switch <= time + reach for switch in self._switches)

    def derivative(self, function: Callable[[float], Any], stretch: float = 1.0) -> Any:
        """Return the rate of a function along the flow by central differences of fourth order."""
        return central_difference(function, stretch * self._unit)
