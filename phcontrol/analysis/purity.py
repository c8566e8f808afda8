"""Whether a law keeps its contract: the same arguments give the same command, and it needs what it says it needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.state_sampler import SampledState, some
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured, measure_truly

_STATES = 12  # that are asked again
_CALLS = 1000  # in between
_SHIFT = 1e-9  # of a time that is close to another [s]
_SEEN = np.array([1e-3, -2e-3, 3e-3])  # features that a law is shown that does not need them [m]


def largest_impurity(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return by how much a command differs when it is asked for again, relative to itself, and where.

    Asked are some of the states in order, then in reverse, close to each other's times, after promises and storage
    functions in between, a thousand times in a mixed order, and twice with the very same view of the arm. Commands
    that were handed out are looked at again: they must not change. Arrays that are handed over cannot be written to,
    and what a view of the arm holds is compared with a fresh one.
    """
    worst, where = 0.0, ""
    for difference, place in _differences(law, plant, states):
        if not difference <= worst:
            worst, where = difference, place
    return worst, where


def _differences(
    law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]
) -> Iterator[tuple[float, str]]:
    chosen = some(states, _STATES, plant.n)
    questions = [_Question(law, plant, state, law.needs) for state in chosen]
    handed_out = [question.command() for question in questions]
    first = [_numbers(command) for command in handed_out]
    for question, before in reversed(list(zip(questions, first, strict=True))):
        question.promise()
        question.ask(_SHIFT)
        yield difference(before, question.ask()), f"asked again in another order: {question.at.stratum}"
    count = max(len(questions), int(_CALLS * min(1.0, (10.0 / plant.n) ** 2)))
    for k in range(count):
        which = (7 * k) % len(questions)
        yield difference(first[which], questions[which].ask()), f"asked again, call {k} of {count}"
    for question, before, command in zip(questions, first, handed_out, strict=True):
        yield difference(before, _numbers(command)), f"a command that was handed out: {question.at.stratum}"
        view = question.fresh_view()
        question.ask(view=view)
        yield difference(before, question.ask(view=view)), f"asked twice with the same view: {question.at.stratum}"
        written = difference(_contents(question.fresh_view()), _contents(view))
        yield written, f"its view was written to: {question.at.stratum}"


def difference_backwards(law: Controller, plant: MechanicalSystem, motion: Sequence[SampledState]) -> float:
    """Return by how much commands along a motion differ when they are asked for backwards."""
    questions = [_Question(law, plant, state, law.needs) for state in motion]
    forwards = [question.ask() for question in questions]
    backwards = [question.ask() for question in reversed(questions)][::-1]
    return max((difference(a, b) for a, b in zip(forwards, backwards, strict=True)), default=0.0)


def largest_hidden_need(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return by how much a command changes when the law is shown more than it says it needs, and where."""
    worst, where = 0.0, ""
    for state in some(states, _STATES, plant.n):
        needed = _Question(law, plant, state, law.needs).ask()
        question = _Question(law, plant, state, Measured._fields)
        if question.measured.features is None:
            question.measured = question.measured._replace(features=_SEEN)
        changed = difference(needed, question.ask())
        if not changed <= worst:
            worst, where = changed, state.stratum
    return worst, where


class _Question:
    """What a law is asked at one state."""

    def __init__(self, law: Controller, plant: MechanicalSystem, at: SampledState, shown: Sequence[str]) -> None:
        self.law, self.at = law, at
        x = plant.at(at.position, at.velocity)
        self.measured = measure_truly(x, _read_only(at.force), shown, at.scene)

    def fresh_view(self) -> MechanicalState:
        return self.law.system.at(self.at.position, self.at.velocity)

    def command(self, shift: float = 0.0, view: MechanicalState | None = None) -> tuple[Array, Array]:
        at = self.at
        seen = self.fresh_view() if view is None else view
        command = self.law.evaluate(at.time + shift, seen, _read_only(at.state), self.measured)
        return command.torque, command.state_rate

    def ask(self, shift: float = 0.0, view: MechanicalState | None = None) -> Array:
        """Return torque and state rate in one array of their own."""
        return _numbers(self.command(shift, view))

    def promise(self) -> None:
        """Ask for everything else."""
        at, view = self.at, self.fresh_view()
        self.law.target(at.time, view, at.state, self.measured)
        self.law.storage(at.time, view, at.state, self.measured)


def _numbers(command: tuple[Array, Array]) -> Array:
    return np.concatenate(command)


def _contents(view: MechanicalState) -> Array:
    """Return what a law could have written to."""
    held = (view.position, view.velocity, view.potential_gradient, view.mass_matrix, view.coriolis_matrix)
    return np.concatenate([np.ravel(array) for array in held])


def difference(before: Array, after: Array) -> float:
    """Return the largest difference of two arrays, relative to the first; infinite for other shapes and NaN."""
    if before.shape != after.shape:
        return float("inf")
    scale = max(float(np.abs(before).max(initial=0.0)), 1e-300)
    changed = float(np.abs(after - before).max(initial=0.0)) / scale
    return float("inf") if np.isnan(changed) else changed


def _read_only(array: Array) -> Array:
    view: Array = array.view()
    view.flags.writeable = False
    return view
