"""One law after another."""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from phcontrol._validation import Array, number, sequence
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import Target
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.vision.scene import Eyes, Scene


class Schedule(Controller):
    """Law A until t₁, then law B until t₂, and so on.

    Hand-over of the controllers' states: the schedule's state has one part for each name that any of the
    laws uses (``state_parts``: "force" for z, "integral" for ξ). Laws that use the same part share it,
    so that it goes on where the last law left it; a part that the active law does not use is held, and
    a part no law has used yet is zero. So force feedback handed over to integral action goes on with its
    z, and ξ starts from zero.

    Each law's storage function and target hold while it is active. At a switch H_d may jump: stability
    of the switched loop is not claimed.

    Args:
        steps: pairs (start time [s], law) in increasing order, the first at 0; all on one system.
    """

    name = "schedule"
    forms = TrajectoryTracking.forms  # its laws may have any

    def __init__(self, steps: Sequence[tuple[float, Controller]]) -> None:
        steps = sequence("steps", steps, "pairs (start time, law)", "__len__")
        if not steps or not all(len(step) == 2 and isinstance(step[1], Controller) for step in steps):
            raise InvalidArgumentError("steps", "must hold at least one pair (start time, law), and nothing else")
        self.starts = [number("start time", start) for start, _ in steps]
        self.laws: list[Controller] = [law for _, law in steps]
        if self.starts[0] != 0.0 or any(a >= b for a, b in zip(self.starts, self.starts[1:], strict=False)):
            raise InvalidArgumentError("steps", f"start times must increase from 0, but are {self.starts}")
        if any(law.system is not self.laws[0].system for law in self.laws):
            raise InvalidArgumentError("steps", "all laws must be made with the same system")
        super().__init__(self.laws[0].system, interconnection=self.laws[0].interconnection)
        self._parts: dict[str, int] = {}
        for law in self.laws:
            self._parts |= law.state_parts
        ends = np.cumsum([0, *self._parts.values()])
        places = {name: np.arange(a, b) for name, a, b in zip(self._parts, ends, ends[1:], strict=False)}
        self._places = [
            np.concatenate([np.zeros(0, dtype=int), *(places[name] for name in law.state_parts)]) for law in self.laws
        ]

    @property
    def state_parts(self) -> dict[str, int]:
        """Every part that one of the laws uses."""
        return dict(self._parts)

    @property
    def needs(self) -> tuple[str, ...]:
        """What any of the laws needs."""
        return tuple(dict.fromkeys(quantity for law in self.laws for quantity in law.needs))

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **wish: Any
    ) -> dict[str, Any]:
        """Refuse: a schedule has laws, not gains."""
        raise InvalidArgumentError("Schedule", "make it of laws: Schedule([(0.0, law), (10.0, other_law)])")

    def active(self, t: float) -> Controller:
        """Return the law that acts at time t [s]."""
        return self.laws[self._index(t)]

    def target_posture(self, t: float) -> Array | None:
        """Return the posture of the active law, or while it has none the first that another law has."""
        postures = [law.target_posture(t) for law in (self.active(t), *self.laws)]
        return next((posture for posture in postures if posture is not None), None)

    def _index(self, t: float) -> int:
        return max(0, bisect.bisect_right(self.starts, t) - 1)

    def _part(self, t: float, state: Array) -> tuple[Controller, Array]:
        index = self._index(t)
        return self.laws[index], state[self._places[index]]

    def evaluate(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Command:
        """Return the active law's torque; parts of the state that it does not use are held."""
        law, part = self._part(t, state)
        command = law.evaluate(t, x, part, measured)
        rate = np.zeros(self.state_size)
        rate[self._places[self._index(t)]] = command.state_rate
        return Command(command.torque, rate)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State what the active law states."""
        law, part = self._part(t, state)
        return law.shape(t, x, part, measured)

    @property
    def time_span(self) -> float:
        """Until the last law has taken over, and as long as any law changes."""
        return max(self.starts[-1], *(start + law.time_span for start, law in zip(self.starts, self.laws, strict=True)))

    @property
    def phases(self) -> tuple[float, ...]:
        """The laws' start times [s]."""
        return tuple(self.starts)

    @property
    def driven_by(self) -> str:
        """What drives any of the laws."""
        return "; ".join(dict.fromkeys(law.driven_by for law in self.laws if law.driven_by))

    @property
    def caveat(self) -> str:
        """What the laws do not claim, and what none of them can."""
        own = ["at a switch H_d may jump"] if len(self.laws) > 1 else []
        return "; ".join(dict.fromkeys([*(law.caveat for law in self.laws if law.caveat), *own]))

    def reference_velocity(self, t: float, x: MechanicalState) -> Array:
        """Return that of the active law."""
        return self.active(t).reference_velocity(t, x)

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

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return the active law's storage function [J]."""
        law, part = self._part(t, state)
        return law.storage(t, x, part, measured)

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return the active law's port."""
        law, part = self._part(t, state)
        return law.passive_port(t, x, part, measured)

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return the active law's calmest state; the other parts are held."""
        law, part = self._part(t, state)
        calm: Array = state.copy()
        calm[self._places[self._index(t)]] = law.calmest_state(t, x, part)
        return calm

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return the active law's coordinates."""
        law, part = self._part(t, state)
        return law.coordinates(t, x, part, measured)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the active law's promise."""
        law, part = self._part(t, state)
        return law.target(t, x, part, measured)
