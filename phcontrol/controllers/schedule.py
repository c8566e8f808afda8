"""One law after another, by the clock."""

from __future__ import annotations

import bisect
from collections.abc import Sequence

from phcontrol._validation import Array, number, sequence
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.law_sequence import Acting, LawSequence
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState


class Schedule(LawSequence):
    """Law A until t₁, then law B until t₂, and so on. :class:`EventSchedule` switches on what happens.

    Hand-over of the controllers' states: the schedule's state has one part for each name that any of the
    laws uses (``state_parts``: "force" for z, "integral" for ξ). Laws that use the same part share it,
    so that it goes on where the last law left it; a part that the active law does not use is held, and
    a part no law has used yet is zero. So force feedback handed over to integral action goes on with its
    z, and ξ starts from zero.

    Each law's storage function and target hold while it is active. At a switch H_d may jump: stability
    of the switched loop is not claimed.

    Args:
        steps: pairs (start time [s], law) in increasing order, the first at 0; all on one system.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, Schedule, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> first, then = EnergyShaping.tuned(system, [0.2, 0.0]), EnergyShaping.tuned(system, [0.0, 0.1])
        >>> schedule = Schedule([(0.0, first), (2.0, then)])  # from when on [s]
        >>> log = simulate(system, schedule, duration=5.0, dt=5e-3, q0=[0.0, 0.0])
        >>> log.position[400].round(1), log.position[-1].round(2)
        (array([0.2, 0. ]), array([0. , 0.1]))
    """

    name = "schedule"

    def __init__(self, steps: Sequence[tuple[float, Controller]]) -> None:
        steps = sequence("steps", steps, "pairs (start time, law)", "__len__")
        if not steps or not all(len(step) == 2 and isinstance(step[1], Controller) for step in steps):
            raise InvalidArgumentError("steps", "must hold at least one pair (start time, law), and nothing else")
        self.starts = [number("start time", start) for start, _ in steps]
        if self.starts[0] != 0.0 or any(a >= b for a, b in zip(self.starts, self.starts[1:], strict=False)):
            raise InvalidArgumentError("steps", f"start times must increase from 0, but are {self.starts}")
        super().__init__([law for _, law in steps])

    def acting(self, t: float, state: Array) -> Acting:
        """Return the law of time t [s]; all laws go by the schedule's clock."""
        index = self._index(t)
        return Acting(self.laws[index], self._places[index], 0.0)

    def active(self, t: float) -> Controller:
        """Return the law that acts at time t [s]."""
        return self.laws[self._index(t)]

    def target_posture(self, t: float) -> Array | None:
        """Return the posture of the active law, or while it has none the first that another law has."""
        postures = [law.target_posture(t) for law in (self.active(t), *self.laws)]
        return next((posture for posture in postures if posture is not None), None)

    def reference_velocity(self, t: float, x: MechanicalState) -> Array:
        """Return that of the active law."""
        return self.active(t).reference_velocity(t, x)

    @property
    def time_span(self) -> float:
        """Until the last law has taken over, and as long as any law changes."""
        return max(self.starts[-1], *(start + law.time_span for start, law in zip(self.starts, self.laws, strict=True)))

    @property
    def phases(self) -> tuple[float, ...]:
        """The laws' start times [s]."""
        return tuple(self.starts)

    def _index(self, t: float) -> int:
        return max(0, bisect.bisect_right(self.starts, t) - 1)
