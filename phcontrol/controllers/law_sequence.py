"""The base of laws that are several laws, of which one acts at a time."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.tanked_law import TANK
from phcontrol.controllers.target import Target
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.vision.scene import Eyes, Scene


class Acting(NamedTuple):
    """Which law acts."""

    law: Controller
    places: Array
    """Where in the sequence's state the law's own is, shape (state size of the law,)."""
    start: float
    """When the law's clock began [s]."""


class LawSequence(Controller):
    """Laws on one system, of which ``acting`` says the one that acts: all that is asked is what that law says.

    The state has one part for each name that any of the laws uses (``state_parts``: "force" for z, "integral" for
    ξ). Laws that use the same part share it, so that it goes on where the last law left it; a part that the acting law
    does not use is held, and a part that no law has used yet is zero.

    Each law's storage function and target hold while it acts. At a switch H_d may jump: stability of the switched loop
    is not claimed.
    """

    forms = TrajectoryTracking.forms  # its laws may have any

    def __init__(self, laws: Sequence[Controller], own_parts: Mapping[str, int] = MappingProxyType({})) -> None:
        self.laws: list[Controller] = list(laws)
        """Every law, in the order of the sequence."""
        if any(law.system is not self.laws[0].system for law in self.laws):
            raise InvalidArgumentError("steps", "all laws must be made with the same system")
        levels = {law.tank_level(np.zeros(law.state_size)) for law in self.laws} - {None}
        if len(levels) > 1:
            started = " and ".join(f"{level:.6g}" for level in sorted(filter(None, levels)))
            message = f"laws share one tank, and must start it at the same initial level, but do at {started} J"
            raise InvalidArgumentError("steps", message)
        super().__init__(self.laws[0].system, interconnection=self.laws[0].interconnection)
        self._parts: dict[str, int] = dict(own_parts)
        for law in self.laws:
            self._parts |= law.state_parts
        ends = np.cumsum([0, *self._parts.values()])
        places = {name: np.arange(a, b) for name, a, b in zip(self._parts, ends, ends[1:], strict=False)}
        self._tank: Array = places.get(TANK, np.zeros(0, dtype=int))
        """Where the tank of the laws that share one is."""
        self._places = [
            np.concatenate([np.zeros(0, dtype=int), *(places[name] for name in law.state_parts)]) for law in self.laws
        ]

    @abstractmethod
    def acting(self, t: float, state: Array) -> Acting:
        """Return the law that acts at time t [s], in a state of the sequence."""

    @property
    def state_parts(self) -> dict[str, int]:
        """Every part that one of the laws uses."""
        return dict(self._parts)

    @property
    def needs(self) -> tuple[str, ...]:
        """What any of the laws needs."""
        return tuple(dict.fromkeys(quantity for law in self.laws for quantity in law.needs))

    @property
    def longest_period(self) -> float:
        """The shortest of those of the laws [s]."""
        return min(law.longest_period for law in self.laws)

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Refuse: a sequence has laws, not gains."""
        raise InvalidArgumentError(cls.__name__, f"make it of laws: {cls.__name__}([(0.0, law), (10.0, other_law)])")

    @property
    def driven_by(self) -> str:
        """What drives any of the laws."""
        return "; ".join(dict.fromkeys(law.driven_by for law in self.laws if law.driven_by))

    @property
    def caveat(self) -> str:
        """What the laws do not claim, and what none of them can."""
        own = ["at a switch H_d may jump"] if len(self.laws) > 1 else []
        return "; ".join(dict.fromkeys([*(law.caveat for law in self.laws if law.caveat), *own]))

    def rest_force(self, x: MechanicalState) -> Array | None:
        """Return that of the first law."""
        return self.laws[0].rest_force(x)

    def rest_scene(self, x: MechanicalState) -> Scene | None:
        """Return that of the first law that has eyes."""
        return next((law.rest_scene(x) for law in self.laws if law.eyes is not None), None)

    @property
    def eyes(self) -> Eyes | None:
        """Those of the first law that has any."""
        return next((law.eyes for law in self.laws if law.eyes is not None), None)

    # --- what the acting law says -----------------------------------------------------------------

    def evaluate(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Command:
        """Return the acting law's torque; parts of the state that it does not use are held."""
        law, places, start = self.acting(t, state)
        command = law.evaluate(t - start, x, state[places], measured)
        rate = np.zeros(self.state_size)
        rate[places] = command.state_rate
        return Command(command.torque, rate)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State what the acting law states."""
        law, places, start = self.acting(t, state)
        return law.shape(t - start, x, state[places], measured)

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return the acting law's storage function [J]."""
        law, places, start = self.acting(t, state)
        return law.storage(t - start, x, state[places], measured)

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return the acting law's port."""
        law, places, start = self.acting(t, state)
        return law.passive_port(t - start, x, state[places], measured)

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return the acting law's calmest state; the other parts are held."""
        law, places, start = self.acting(t, state)
        calm: Array = state.copy()
        calm[places] = law.calmest_state(t - start, x, state[places])
        return calm

    def rate_under_limits(
        self, t: float, x: MechanicalState, state: Array, rate: Array, change: Array, measured: Measured = NOTHING
    ) -> Array:
        """Return the acting law's; parts of the state that it does not use are held."""
        law, places, start = self.acting(t, state)
        counted: Array = rate.copy()
        counted[places] = law.rate_under_limits(t - start, x, state[places], rate[places], change, measured)
        return counted

    def tank_level(self, state: Array) -> float | None:
        """Return the energy in the tank that its laws share [J]; None where none has one."""
        for law, places in zip(self.laws, self._places, strict=True):
            level = law.tank_level(state[places])
            if level is not None:
                return level
        return None

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return the acting law's coordinates."""
        law, places, start = self.acting(t, state)
        return law.coordinates(t - start, x, state[places], measured)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the acting law's promise."""
        law, places, start = self.acting(t, state)
        return law.target(t - start, x, state[places], measured)
