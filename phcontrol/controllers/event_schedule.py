"""One law after another, on what happens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np

from phcontrol._validation import Array, positive, sequence, text
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.events import Event, Moment
from phcontrol.controllers.law_sequence import Acting, LawSequence
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.setpoints.live_parts import live_parts

STOP = "stop"
"""The phase that a schedule ends in when what it waits for does not come."""
BOOK = "schedule"
"""The part of the state in which a schedule keeps where it is."""

# what the book holds, before the times since when each event has held, and the hand-over
_PHASE, _SINCE, _LAW_SINCE, _LEFT, _CAUSE, _BEFORE, _AFTER, _TORQUE, _HEAD = range(9)
_NEVER = -1.0
_TIME_OUT = -1.0


class HandOver(NamedTuple):
    """The arm at the instant at which a law takes over.

    Example:
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, HandOver, MechanicalSystem, load_robot
        >>> at = HandOver(position=np.array([0.1, 0.0]), desired=np.array([0.2, 0.0]), features=np.zeros(3))
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> EnergyShaping.tuned(system, at.desired).goal  # what a function of a Phase makes of it
        array([0.2, 0. ])
    """

    position: Array
    """q, shape (n,) [rad]."""
    desired: Array
    """The posture that the last law desired, shape (n,) [rad]; q, where it desired none of the joints."""
    features: Array
    """Image features (μ, ν, l) that are measured, shape (3,) [m]; zeros where none are."""


LawAtHandOver = Callable[[HandOver], Controller]
"""Makes a law from where it takes over: a pure function."""


@dataclass(frozen=True)
class Phase:
    """A law, and what ends it.

    Args:
        name: of the phase.
        law: a law; or a function that makes one from the :class:`HandOver` (then its desired posture can begin where
            the arm is, whatever came before); or the name of an earlier phase, whose law just goes on.
        then: pairs (event, name of the next phase); the first that happens counts. None for the last phase.
        within: how long to wait for one of them [s]; then the schedule ends in its stop.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, Phase, Touched, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> Phase("wait", EnergyShaping.tuned(system), [(Touched(0.5), "go")], within=3.0).within  # [s]
        3.0
    """

    name: str
    law: Controller | LawAtHandOver | str
    then: Sequence[tuple[Event, str]] = ()
    within: float | None = None


class Switch(NamedTuple):
    """What a schedule did at one instant.

    Example:
        >>> from phcontrol import Switch
        >>> print(Switch(1.0, "wait", "go", "touched", 0.2, 0.5, 0.01))
        1.00 s: wait -> go (touched); H_d 0.2 J -> 0.5 J, torque jumps by 0.01 N·m
    """

    time: float
    """[s]."""
    leaving: str
    entering: str
    event: str
    """What happened; or what did not, and for how long it was waited for."""
    storage_before: float
    """H_d of the law that left, at that instant [J]."""
    storage_after: float
    """H_d of the law that took over [J]."""
    torque_jump: float
    """Largest change of a joint's torque [N·m]."""

    def __str__(self) -> str:
        return (
            f"{self.time:.2f} s: {self.leaving} -> {self.entering} ({self.event}); H_d {self.storage_before:.3g} J -> "
            f"{self.storage_after:.3g} J, torque jumps by {self.torque_jump:.2g} N·m"
        )


class EventSchedule(LawSequence):
    """A law until something happens (seen, touched, settled, lost), then another, and so on.

    Which law acts is a part of the state ("schedule"), changed by ``jump`` at instants and never in between, so that
    ``evaluate`` stays a pure function of time, state and measurements. The clock of each law starts with its phase.

    Hand-over: a law that is made at its :class:`HandOver` begins with its own calmest state, where H_d is smallest, and
    can take the posture there for its goal or for the start of its reference: then what is desired does not jump. Its
    energy tank goes on with what is left in it: entering a phase again fills nothing. Laws that are given share the
    parts of their state, as in a :class:`Schedule`. Each law's H_d and target hold while it
    acts; by how much H_d and the torque jump at each switch is kept (``switches``), and nothing is claimed about it.

    A certificate is made of each of its ``laws``, one by one: of the whole, whose H_d jumps, there is none.

    Each phase but the last says how long it waits. When nothing that it waits for happens ``within`` that, or a phase
    leads there, the schedule ends in its stop, and ``report`` says so: the arm is held where it is.

    Args:
        phases: in their order; the first acts first.
        stop: what makes the law of the stop; by default energy shaping about where the arm is.

    Example:
        >>> from phcontrol import After, EnergyShaping, EventSchedule, MechanicalSystem, Phase, load_robot
        >>> from phcontrol import simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> wait, go = EnergyShaping.tuned(system, [0.0, 0.0]), EnergyShaping.tuned(system, [0.2, 0.0])
        >>> schedule = EventSchedule([Phase("wait", wait, [(After(0.5), "go")], within=2.0), Phase("go", go)])
        >>> log = simulate(system, schedule, duration=1.0, dt=5e-3, q0=[0.0, 0.0])
        >>> [(switch.leaving, switch.entering) for switch in schedule.switches(log.time, log.controller_state)]
        [('wait', 'go')]
    """

    name = "event_schedule"
    jumps = True

    def __init__(self, phases: Sequence[Phase], *, stop: LawAtHandOver | None = None) -> None:
        given = sequence("phases", phases, "phases (Phase)", "name", "law", "then", "within")
        if not given:
            raise InvalidArgumentError("phases", "must hold at least one Phase")
        for phase in given:
            if text("name", phase.name) == STOP:
                raise InvalidArgumentError("phases", f"'{STOP}' is the name of the stop: call the phase otherwise")
        system = next((phase.law.system for phase in given if isinstance(phase.law, Controller)), None)
        if system is None:
            home = [phase.law for phase in given if callable(phase.law)]
            if not home:
                raise InvalidArgumentError("phases", "must hold a law")
            raise InvalidArgumentError(
                "phases", "must hold at least one law that is given, whose system all others share"
            )
        self._phases: tuple[Phase, ...] = (*given, Phase(STOP, stop or _holding(system)))
        self.names = tuple(phase.name for phase in self._phases)
        """Names of the phases, the stop last."""
        if len(set(self.names)) < len(self.names):
            raise InvalidArgumentError("phases", f"must have names of their own, but are {', '.join(self.names)}")
        at_home = HandOver(system.robot.home, system.robot.home, np.zeros(3))
        self._sources = [self._source(index) for index in range(len(self._phases))]
        self._last_made: dict[int, tuple[bytes, Controller]] = {}
        examples = [_law(self._phases[source], at_home, system) for source in self._sources]
        most = max(len(phase.then) for phase in self._phases)
        self._handover = _HEAD + most
        super().__init__(examples, {BOOK: self._handover + 2 * system.n + 3})
        self._check_events()

    def acting(self, t: float, state: Array) -> Acting:
        """Return the law of the phase that the state says."""
        index = self._index(state)
        start = float(state[_LAW_SINCE])
        return Acting(self._law_of(index, state), self._places[index], start if start != _NEVER else t)

    def phase(self, state: Array) -> str:
        """Return the name of the phase that a state is in."""
        return self.names[self._index(state)]

    @property
    def needs(self) -> tuple[str, ...]:
        """What the laws and the events need."""
        events = [event for phase in self._phases for event, _ in phase.then]
        return tuple(dict.fromkeys([*super().needs, *(name for event in events for name in event.needs)]))

    def initial_state(self, x: MechanicalState) -> Array:
        """Return the state before the first instant, at which the first phase begins."""
        state = np.zeros(self.state_size)
        state[: self._handover] = _NEVER
        state[_PHASE] = 0.0
        state[_BEFORE:_HEAD] = 0.0
        self._book_handover(state, HandOver(x.position, x.position, np.zeros(3)))
        law = self._law_of(0, state)
        state[self._places[0]] = law.initial_state(x)
        return state

    def jump(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return the state after what has happened by time t [s]: the same, or with another phase."""
        after: Array = state.copy()
        if after[_SINCE] == _NEVER:
            after[_SINCE] = after[_LAW_SINCE] = t
        index = self._index(after)
        phase, law = self._phases[index], self._law_of(index, after)
        elapsed = t - float(after[_SINCE])
        moment = Moment(x, measured, law, t - float(after[_LAW_SINCE]), elapsed, self.eyes)
        for number, (event, following) in enumerate(phase.then):
            place = _HEAD + number
            if not event.holds(moment):
                after[place] = _NEVER
                continue
            if after[place] == _NEVER:
                after[place] = t
            if t - after[place] >= event.lasting - 1e-9:
                return self._entered(t, x, after, measured, self.names.index(following), number)
        if phase.within is not None and elapsed >= phase.within - 1e-9:
            return self._entered(t, x, after, measured, len(self._phases) - 1, _TIME_OUT)
        return after

    def switches(self, times: Array, states: Array) -> list[Switch]:
        """Return every switch of a run, from its times, shape (N,) [s], and controller states, shape (N, size)."""
        found = []
        for k in range(1, len(times)):
            if states[k][_SINCE] != states[k - 1][_SINCE] and states[k - 1][_SINCE] != _NEVER:
                found.append(self._switch(states[k]))
        return found

    def report(self, state: Array) -> str:
        """Return in words where the schedule is, since when, and what brought it there."""
        since = float(state[_SINCE])
        if since == _NEVER:
            return f"about to begin with '{self.names[0]}'"
        if state[_LEFT] == _NEVER:
            return f"in '{self.phase(state)}' since {since:.2f} s"
        switch = self._switch(state)
        place = "STOPPED" if switch.entering == STOP else f"in '{switch.entering}'"
        return f"{place} since {since:.2f} s, out of '{switch.leaving}': {switch.event}"

    def random_state(self, generator: np.random.Generator) -> Array:
        """Draw a state: any phase, entered at any posture."""
        state = super().random_state(generator)
        position = self.system.robot.random_position(generator)
        state[: self._handover] = _NEVER
        state[_PHASE] = generator.integers(len(self._phases))
        self._book_handover(state, HandOver(position, position, np.zeros(3)))
        return state

    # --- how it does that ---------------------------------------------------------------------------

    def _entered(
        self, t: float, x: MechanicalState, state: Array, measured: Measured, index: int, cause: float
    ) -> Array:
        """Return the state with which another phase begins."""
        leaving = self.acting(t, state)
        own = state[leaving.places]
        after: Array = state.copy()
        after[: self._handover] = _NEVER
        goes_on = self._sources[index] == self._sources[self._index(state)]
        after[_PHASE], after[_SINCE], after[_LEFT], after[_CAUSE] = index, t, self._index(state), cause
        after[_LAW_SINCE] = state[_LAW_SINCE] if goes_on else t
        if not goes_on:
            desired = leaving.law.desired_posture(t - leaving.start, own)
            self._book_handover(
                after, HandOver(x.position, x.position if desired is None else desired, _seen(measured))
            )
            if not isinstance(self._phases[index].law, Controller):
                law, places = self._law_of(index, after), self._places[index]
                after[places] = law.initial_state(x)
                after[self._tank] = state[self._tank]  # what is left in it: no law is made with energy of its own
                after[places] = law.calmest_state(0.0, x, after[places])
        before, now = (self.evaluate(t, x, each, measured).torque for each in (state, after))
        after[_BEFORE] = leaving.law.storage(t - leaving.start, x, own, measured)
        after[_AFTER] = self.storage(t, x, after, measured)
        after[_TORQUE] = np.abs(now - before).max()
        return after

    def _switch(self, state: Array) -> Switch:
        """Return the switch that led to a state."""
        phase, cause = self._phases[int(state[_LEFT])], int(state[_CAUSE])
        events = " or ".join(f"'{event}'" for event, _ in phase.then)
        what = str(phase.then[cause][0]) if cause >= 0 else f"nothing of {events} within {phase.within:g} s"
        figures = (float(state[place]) for place in (_BEFORE, _AFTER, _TORQUE))
        return Switch(float(state[_SINCE]), phase.name, self.phase(state), what, *figures)

    def _index(self, state: Array) -> int:
        return int(min(max(0.0, round(float(state[_PHASE]))), len(self._phases) - 1))

    def _source(self, index: int) -> int:
        """Return the phase whose law a phase has: its own, or that of the phase it names."""
        law = self._phases[index].law
        if not isinstance(law, str):
            return index
        earlier = self.names[:index]
        if law not in earlier:
            raise UnknownNameError("earlier phase", law, earlier)
        return self._source(self.names.index(law))

    def _law_of(self, index: int, state: Array) -> Controller:
        """Return the law of a phase, made at the hand-over that the state keeps."""
        source = self._sources[index]
        phase = self._phases[source]
        if isinstance(phase.law, Controller):
            return phase.law
        kept = np.array(state[self._handover : self._handover + 2 * self.system.n + 3])
        key, known = kept.tobytes(), self._last_made.get(source)
        if known is None or known[0] != key:
            law = _law(phase, HandOver(*np.split(kept, (self.system.n, 2 * self.system.n))), self.system)
            if law.state_parts != self.laws[index].state_parts:
                raise InvalidArgumentError(
                    "law", f"made at hand-over of '{phase.name}' must have the same states everywhere"
                )
            level = law.tank_level(np.zeros(law.state_size))
            if level != self.laws[index].tank_level(np.zeros(law.state_size)):
                message = f"made at hand-over of '{phase.name}' must start its tank at the same level everywhere"
                raise InvalidArgumentError("law", message)
            known = self._last_made[source] = (key, law)
        return known[1]

    def _book_handover(self, state: Array, at: HandOver) -> None:
        state[self._handover : self._handover + 2 * self.system.n + 3] = np.concatenate(at)

    def _check_events(self) -> None:
        reached = {self.names[0], STOP}
        for phase in self._phases:
            if phase.then and phase.within is None:
                raise InvalidArgumentError(
                    "within", f"of phase '{phase.name}' must say how long it waits for its events"
                )
            if phase.within is not None:
                positive("within", phase.within)
            if phase.within is not None and not phase.then:
                raise InvalidArgumentError("within", f"of phase '{phase.name}', which waits for nothing, must be None")
            for pair in phase.then:
                if len(pair) != 2 or not isinstance(pair[0], Event):
                    raise InvalidArgumentError("then", f"of phase '{phase.name}' must hold pairs (event, next phase)")
                event, following = pair
                if following not in self.names:
                    raise UnknownNameError("phase", following, self.names)
                event.check(self.system.robot.joint_names, self.eyes)
                reached.add(following)
        lonely = set(self.names) - reached
        if lonely:
            raise InvalidArgumentError("phases", f"no event leads to {', '.join(sorted(lonely))}")


def _seen(measured: Measured) -> Array:
    """Return the measured features; zeros, of which a state can be made, where none are."""
    features = measured.features
    return np.zeros(3) if features is None or not np.isfinite(features).all() else features


def _law(phase: Phase, at: HandOver, system: MechanicalSystem) -> Controller:
    """Return the law of a phase at a hand-over."""
    law = phase.law if isinstance(phase.law, Controller) else cast(LawAtHandOver, phase.law)
    if not callable(law) and not isinstance(law, Controller):
        raise InvalidArgumentError("law", f"of phase '{phase.name}' must be a law, or a function that makes one")
    made = law if isinstance(law, Controller) else law(at)
    if not isinstance(made, Controller) or isinstance(made, LawSequence):
        raise InvalidArgumentError("law", f"of phase '{phase.name}' must be one law, but is {type(made).__name__}")
    if made.system is not system:
        raise InvalidArgumentError("phases", "all laws must be made with the same system")
    if live_parts(made):
        message = "follows a live goal, whose time is the loop's: here each law's begins with its phase; use a Schedule"
        raise InvalidArgumentError("law", f"of phase '{phase.name}' {message}")
    return made


def _holding(system: MechanicalSystem) -> LawAtHandOver:
    """Return what makes a law that holds the arm where it is."""
    return lambda at: EnergyShaping.tuned(system, at.position)
