"""The plant's true motion out of one state, along which promises are differentiated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.analysis.state_sampler import SampledState
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured, measure_truly

STEP = 2e-4
"""Of the finite differences [s]; shorter where the arm moves fast."""


class Flow:
    """The straight line through one state along the closed loop's true vector field.

    Its derivative at 0 is that of the closed loop: forward dynamics of the plant under the law's torque. The law is
    shown what it says it needs, and nothing else.
    """

    def __init__(self, law: Controller, plant: MechanicalSystem, at: SampledState) -> None:
        self._law, self._plant, self._at = law, plant, at
        x = plant.at(at.position, at.velocity)
        self._measured = measure_truly(x, at.force, law.needs, at.scene)
        command = law.evaluate(at.time, law.system.at(at.position, at.velocity), at.state, self._measured)
        self._state_rate = command.state_rate
        self._acceleration = x.acceleration(command.torque, at.force)
        self._unit = STEP / max(1.0, float(np.abs(at.velocity).max()))

    def measured(self, shift: float) -> Measured:
        """Return what sensors show ``shift`` seconds along the flow: the same forces, and where the object then is."""
        if self._at.scene is None or self._measured.features is None:
            return self._measured
        x = self._plant.at(self._at.position + shift * self._at.velocity)
        return self._measured._replace(features=self._at.scene.features(x, self._at.scene.initial_state()))

    def view(self, shift: float) -> MechanicalState:
        """Return the controller's view of the plant ``shift`` seconds along the flow."""
        position = self._at.position + shift * self._at.velocity
        return self._law.system.at(position, self._at.velocity + shift * self._acceleration)

    def coordinates(self, shift: float) -> Array:
        """Return the target's coordinates ``shift`` seconds along the flow."""
        state = self._at.state + shift * self._state_rate
        return self._law.coordinates(self._at.time + shift, self.view(shift), state, self.measured(shift))

    def storage(self, shift: float) -> float:
        """Return H_d ``shift`` seconds along the flow [J]."""
        state = self._at.state + shift * self._state_rate
        return self._law.storage(self._at.time + shift, self.view(shift), state, self.measured(shift))

    def derivative(self, function: Callable[[float], Any], stretch: float = 1.0) -> Any:
        """Return the rate of a function along the flow by central differences of fourth order."""
        return central_difference(function, stretch * self._unit)
