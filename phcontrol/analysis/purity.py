"""Whether a law keeps its contract: the same arguments give the same answers, and it needs what it says it needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen, largest_difference
from phcontrol.analysis.state_sampler import some
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured

_STATES = 12  # that are asked again
_CALLS = 1000  # in between
_SEEING, _DERIVED = 10, 5  # times fewer of laws that need a camera, or whose torque is derived from the target
_SHIFT = 1e-9  # of a time that is close to another [s]
_SEEN = np.array([1e-3, -2e-3, 3e-3])  # features that a law is shown that does not need them [m]


def largest_impurity(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much an answer differs when it is asked for again, relative to itself, and where.

    Asked are some of the states in order, then in reverse, close to each other's times, after other questions and
    after other uses of the law's model in between, a thousand times in a mixed order, and twice with the very same
    view of the arm. So are the promises, and where the law rests. Commands that were handed out are looked at again:
    they must not change. Arrays that are handed over cannot be written to, and what a view of the arm holds is
    compared with a fresh one.
    """
    return Worst.of(_differences(law, plant, states))


def _differences(
    law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]
) -> Iterator[tuple[float, str]]:
    questions = [Seen.of(law, plant, guarded(at)) for at in some(states, _STATES, plant.n)]
    handed_out = [question.command() for question in questions]
    first = [_copies(command) for command in handed_out]
    promised = [everything_else(question) for question in questions]
    for question, said, before in reversed(list(zip(questions, promised, first, strict=True))):
        place = question.at.stratum
        yield (
            largest_difference(said, everything_else(question.elsewhere())),
            f"promised again in another order: {place}",
        )
        answers(question.elsewhere(time=question.at.time + _SHIFT))
        _use(question.elsewhere().view)
        yield largest_difference(before, answers(question)), f"asked again in another order: {place}"
    count = max(len(questions), int(_CALLS * min(1.0, (10.0 / plant.n) ** 2)))
    for k in range(count):
        which = (7 * k) % len(questions)
        yield largest_difference(first[which], answers(questions[which])), f"asked again, call {k} of {count}"
    for question, before, command in zip(questions, first, handed_out, strict=True):
        place = question.at.stratum
        yield largest_difference(before, command), f"a command that was handed out: {place}"
        seen = question.elsewhere()
        seen.command()
        yield largest_difference(before, seen.command()), f"asked twice with the same view: {place}"
        written = largest_difference(_contents(question.elsewhere().view), _contents(seen.view))
        yield written, f"its view was written to: {place}"


def slowness(law: Controller) -> int:
    """Return how many times fewer questions a law is asked where it is asked thousands: it sees, or is derived."""
    if law.eyes is not None:
        return _SEEING
    kind = type(law)
    return _DERIVED if kind.evaluate is Controller.evaluate and kind.shape is Controller.shape else 1


def largest_hidden_need(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much a command changes when the law is shown more than it says it needs, and where."""

    def change(at: SampledState) -> float:
        more = Seen.of(law, plant, guarded(at), Measured._fields)
        if more.measured.features is None:
            more.measured = more.measured._replace(features=_SEEN)
        return largest_difference(Seen.of(law, plant, guarded(at)).command(), more.command())

    return Worst.of((change(at), at.stratum) for at in some(states, _STATES, plant.n))


def guarded(at: SampledState) -> SampledState:
    """Return a state whose arrays cannot be written to."""
    return at._replace(force=_read_only(at.force), state=_read_only(at.state))


def answers(seen: Seen) -> list[Array]:
    """Return torque and state rate, asked for with a fresh view, in arrays of their own."""
    return _copies(seen.elsewhere().command())


def _copies(arrays: Sequence[Array]) -> list[Array]:
    return [np.array(array) for array in arrays]


def everything_else(seen: Seen) -> list[Array]:
    """Return everything else that the law says."""
    law, at = seen.law, seen.at
    postures = law.rest_posture(at.time), law.initial_state(seen.view)
    return [np.array([seen.stored()]), *seen.promise(), *_copies(postures)]


def _use(x: MechanicalState) -> None:
    """Use the model that a law computes with, as the loop, a filter or another law does between two of its calls."""
    model = x.system.model
    pin.computeAllTerms(model, x.system.data, pin.neutral(model), np.ones(model.nv))


def _contents(view: MechanicalState) -> list[Array]:
    """Return what a law could have written to."""
    return [view.position, view.velocity, view.potential_gradient, view.mass_matrix, view.coriolis_matrix]


def _read_only(array: Array) -> Array:
    view: Array = array.view()
    view.flags.writeable = False
    return view
