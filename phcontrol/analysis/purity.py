"""Whether a law keeps its contract: the same arguments give the same command, and it needs what it says it needs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.state_sampler import SampledState
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured, measure_truly

_STATES = 12  # that are asked again
_CALLS = 1000  # between the first and the last time
_SHIFT = 1e-9  # of a time that is close to another [s]


def largest_impurity(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return by how much a command differs when it is asked for again, relative to itself, and where.

    Asked are some of the states in order, then in reverse, after each other's times and close to them, after promises
    and storage functions in between, and once more after a thousand calls. Arrays that are handed over cannot be
    written to.
    """
    chosen = states[:: max(1, len(states) // _STATES)][:_STATES]
    questions = [_Question(law, plant, state, law.needs) for state in chosen]
    first = [question.ask() for question in questions]
    worst, where = 0.0, ""

    def compare(question: _Question, before: Array, when: str) -> None:
        nonlocal worst, where
        after = question.ask()
        difference = _difference(before, after)
        if not difference <= worst:
            worst, where = difference, f"{when}: {question.at.stratum}"

    for question, before in reversed(list(zip(questions, first, strict=True))):
        question.promise()
        question.ask(_SHIFT)
        compare(question, before, "asked again in another order")
    count = max(len(questions), int(_CALLS * min(1.0, (10.0 / plant.n) ** 2)))
    for k in range(count):
        questions[(7 * k) % len(questions)].ask()
    for question, before in zip(questions, first, strict=True):
        compare(question, before, f"asked again after {count} calls")
    return worst, where


def largest_hidden_need(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return by how much a command changes when the law is shown more than it says it needs, and where."""
    worst, where = 0.0, ""
    for state in states[:: max(1, len(states) // _STATES)][:_STATES]:
        needed = _Question(law, plant, state, law.needs).ask()
        difference = _difference(needed, _Question(law, plant, state, Measured._fields).ask())
        if not difference <= worst:
            worst, where = difference, state.stratum
    return worst, where


def signal_depends_on_state(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> bool:
    """Return whether what drives the law changes with the state of arm or controller, time and measurements held."""
    for here, there in itertools.pairwise(states[: _STATES + 1]):
        question = _Question(law, plant, here, law.needs)
        own = law.target(here.time, question.view, here.state, question.measured).drive
        moved = law.system.at(there.position, there.velocity)
        other = law.target(here.time, moved, there.state, question.measured).drive
        if (own is None) != (other is None):
            return True
        if own is not None and other is not None and not np.array_equal(own.signal, other.signal):
            return True
    return False


class _Question:
    """What a law is asked at one state."""

    def __init__(self, law: Controller, plant: MechanicalSystem, at: SampledState, shown: Sequence[str]) -> None:
        self.law, self.at = law, at
        x = plant.at(at.position, at.velocity)
        self.view = law.system.at(at.position, at.velocity)
        self.measured = measure_truly(x, _read_only(at.force), shown, at.scene)

    def ask(self, shift: float = 0.0) -> Array:
        """Return torque and state rate, from a view of its own."""
        at = self.at
        view = self.law.system.at(at.position, at.velocity)
        command = self.law.evaluate(at.time + shift, view, _read_only(at.state), self.measured)
        return np.concatenate([command.torque, command.state_rate])

    def promise(self) -> None:
        """Ask for everything else."""
        at = self.at
        self.law.target(at.time, self.view, at.state, self.measured)
        self.law.storage(at.time, self.view, at.state, self.measured)


def _difference(before: Array, after: Array) -> float:
    if before.shape != after.shape:
        return float("inf")
    scale = max(float(np.abs(before).max(initial=0.0)), 1e-300)
    difference = float(np.abs(after - before).max(initial=0.0)) / scale
    return float("inf") if np.isnan(difference) else difference


def _read_only(array: Array) -> Array:
    view: Array = array.view()
    view.flags.writeable = False
    return view
