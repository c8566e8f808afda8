"""Whether a law remembers: what it was asked before, when, how often, or by which of its methods."""

from __future__ import annotations

import copy
import inspect
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.purity import answers, everything_else, guarded, slowness
from phcontrol.analysis.rest_point import RestPoint
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen, largest_difference
from phcontrol.analysis.state_sampler import FIRST_TIME, some
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import ObjectLostError
from phcontrol.mechanics.system import MechanicalSystem

_IN_A_DECADE = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.3, 8.0)
PERIODS = (*(scale * period for scale in (1e-4, 1e-3) for period in _IN_A_DECADE), 1e-2)
"""Of control loops, ten a decade from 0.1 to 10 ms, with those in use among them [s]."""
_STEPS, _JUMPS = 8, 4  # of a walk in closed loop, and of one anywhere
_AWAY, _IN_VIEW = 0.3, 0.02  # from rest, where walks begin, in natural units; likewise of a law with eyes
_WILD = 30.0  # times the velocity limits: there a walk with a long period ends
_LONG, _SHORT = 3000, 200  # periods of 1 ms that the clock runs for, and of these others
_USED = (2.5e-4, 5e-4, 2e-3, 4e-3, 5e-3, 8e-3, 1e-2)
_KEPT = 50  # of the answers meanwhile one in so many is compared
_QUESTIONS = 6  # that are asked again after each method
_MAKING = ("tuned", "tuning", "default_gains", "check_goal", "prepare", "changed")  # methods that make another law


def untouched(law: Controller) -> Controller | None:
    """Return a copy of a law that nobody has asked anything; None where it cannot be copied."""
    try:
        return copy.deepcopy(law, {id(law.system): law.system})
    except Exception:  # a law of one's own may hold anything
        return None


def difference_in_walks(
    law: Controller, fresh: Controller | None, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint
) -> Worst:
    """Return by how much commands along motions differ from those to the same questions in other orders, and where.

    Motions are the sampled closed loop's, with each period from 0.1 to 10 ms, and leaps about it at the same
    periods, at one time, and at times of any order: what a loop would ask. Each question is asked again backwards,
    and a copy of the law that was asked nothing else in a mixed order.
    """
    return Worst.of(_differences_in_walks(law, fresh, plant, units, rest))


def _differences_in_walks(
    law: Controller, fresh: Controller | None, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint
) -> Iterator[tuple[float, str]]:
    generator = np.random.default_rng(0)
    start = _start(law, units, rest)
    away = _AWAY if start.scene is None else _IN_VIEW
    for k, period in enumerate(PERIODS):
        for words, walk in (
            ("in closed loop", _closed_loop(law, plant, units, start, period)),
            ("by leaps", _leaps(law, plant, units, start, period * np.arange(_JUMPS), away, generator)),
        ):
            yield _compared(law, fresh, plant, list(walk)), f"asked with a period of {1e3 * period:.3g} ms, {words}"
        if k % 7 == 0:
            times = np.concatenate([np.zeros(_JUMPS), generator.permutation(PERIODS)[:_JUMPS]])
            leaps = list(_leaps(law, plant, units, start, times, away, generator))
            yield _compared(law, fresh, plant, leaps), "asked for the same time and for times of any order"


def _start(law: Controller, units: NaturalUnits, rest: RestPoint) -> SampledState:
    """Return where walks begin: away from rest, where something has to be done."""
    scene = law.rest_scene(law.system.at(rest.position))
    away = _AWAY if scene is None else _IN_VIEW
    time = max(rest.time, FIRST_TIME if law.time_span else 0.0)
    position = rest.position + away * units.position
    return SampledState(time, position, rest.velocity, rest.state, rest.force, scene, "")


Asked = tuple[SampledState, Sequence[Array]]
"""A question, and what was answered."""


def _closed_loop(
    law: Controller, plant: MechanicalSystem, units: NaturalUnits, start: SampledState, period: float
) -> Iterator[Asked]:
    """Return the questions of a sampled loop and their answers: each is asked once, in the order of time."""
    at = start
    for k in range(1, _STEPS + 1):
        seen = Seen.of(law, plant, guarded(at))
        try:
            torque, state_rate = said = answers(seen)
        except ObjectLostError:
            return
        yield at, said
        velocity = at.velocity + period * plant.at(at.position, at.velocity).acceleration(torque, at.force)
        if not (np.abs(velocity) < _WILD * units.speed).all():
            return
        at = at._replace(
            time=start.time + k * period,
            position=at.position + period * velocity,
            velocity=velocity,
            state=at.state + period * state_rate,
        )


def _leaps(
    law: Controller,
    plant: MechanicalSystem,
    units: NaturalUnits,
    start: SampledState,
    times: Iterable[float],
    away: float,
    generator: np.random.Generator,
) -> Iterator[Asked]:
    """Return questions about the start at some times after it, each in another state, and their answers."""
    n, m = plant.n, start.state.size
    for time in times:
        at = start._replace(
            time=start.time + float(time),
            position=start.position + away * units.position * generator.uniform(-0.5, 0.5, n),
            velocity=start.velocity + away * units.speed * generator.uniform(-0.5, 0.5, n),
            state=start.state + away * units.state * generator.uniform(-0.5, 0.5, m),
        )
        try:
            yield at, answers(Seen.of(law, plant, guarded(at)))
        except ObjectLostError:
            return


def _compared(law: Controller, fresh: Controller | None, plant: MechanicalSystem, asked: Sequence[Asked]) -> float:
    """Return by how much answers differ when they are asked for backwards, and of a copy in a mixed order."""
    worst = 0.0
    for at, said in reversed(asked):
        worst = max(worst, largest_difference(said, answers(Seen.of(law, plant, guarded(at)))))
    if fresh is not None:
        for at, said in [*asked[1::2], *asked[::2]]:
            worst = max(worst, largest_difference(said, answers(Seen.of(fresh, plant, guarded(at)))))
    return worst


def difference_after_marching(law: Controller, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint) -> Worst:
    """Return by how much commands while the clock runs, as in a loop, differ when asked for backwards, and where.

    It runs for three seconds in periods of 1 ms, and for two hundred periods of lengths that are in use, while the arm
    stands: a memory that wakes up late shows.
    """
    at = _start(law, units, rest)
    seen = Seen.of(law, plant, guarded(at))

    def ask(time: float) -> list[Array]:
        command = law.evaluate(float(time), seen.view, at.state, seen.measured)
        return [np.array(command.torque), np.array(command.state_rate)]

    def difference(period: float, count: int) -> float:
        times = at.time + period * np.arange(count // slowness(law) + 1)
        forwards = [ask(time) for time in times][::_KEPT]
        backwards = [ask(time) for time in times[::_KEPT][::-1]][::-1]
        return max(largest_difference(a, b) for a, b in zip(forwards, backwards, strict=True))

    marches = [(1e-3, _LONG), *((period, _SHORT) for period in _USED)]
    return Worst.of((difference(*march), f"after many periods of {1e3 * march[0]:.3g} ms") for march in marches)


def difference_after_methods(
    law: Controller, fresh: Controller | None, plant: MechanicalSystem, states: Sequence[SampledState]
) -> Worst:
    """Return by how much commands differ after other methods of the law were asked about other states, and where.

    Every public method that can be called with what laws are asked with is called, and every property read, in a
    random order; then the commands are asked for again. At last a copy that was asked nothing before must say the same.
    """
    return Worst.of(_differences_after_methods(law, fresh, plant, states))


def _differences_after_methods(
    law: Controller, fresh: Controller | None, plant: MechanicalSystem, states: Sequence[SampledState]
) -> Iterator[tuple[float, str]]:
    generator = np.random.default_rng(0)
    questions = [Seen.of(law, plant, guarded(at)) for at in some(states, _QUESTIONS, plant.n)]
    first = [answers(question) for question in questions]
    calls = [(name, turn) for name in _methods(law) for turn in range(2)]
    for k in generator.permutation(len(calls)):
        name, turn = calls[k]
        which = (int(k) + turn) % len(questions)
        _call(law, name, questions[which - 1].elsewhere(), generator)
        yield largest_difference(first[which], answers(questions[which].elsewhere())), f"after {name}() was asked"
    if fresh is None:
        return
    copies = [Seen(fresh, question.at, question.measured) for question in questions]
    for alone, before in zip(copies, first, strict=True):
        yield largest_difference(before, answers(alone)), "a copy of the law that was asked nothing else"
    for alone, question in zip(copies, questions, strict=True):
        promised = everything_else(question.elsewhere()), everything_else(alone.elsewhere())
        yield largest_difference(*promised), "what a copy of the law promises that was asked nothing else"


def _methods(law: Controller) -> list[str]:
    """Return the names of the law's public methods and properties, but for those that make another law."""
    kind = type(law)
    return [name for name in dir(kind) if not name.startswith("_") and name not in (*_MAKING, *kind.parameters)]


def _call(law: Controller, name: str, seen: Seen, generator: np.random.Generator) -> None:
    """Call a method with what it asks for by name, or read a property; what it raises is no answer."""
    at, n = seen.at, law.system.n
    given: dict[str, Any] = {
        "t": at.time, "x": seen.view, "state": at.state, "measured": seen.measured, "generator": generator,
        "rate": generator.uniform(-1.0, 1.0, law.state_size), "change": generator.uniform(-1.0, 1.0, n),
    }  # fmt: skip
    try:
        found = getattr(law, name)
        if not callable(found):
            return
        wanted = _parameters(law, name)
        known = [given[each.name] for each in wanted if each.name in given]
        if all(each.name in given or each.default is not each.empty for each in wanted):
            found(*known)
    except Exception:
        return


def _parameters(law: Controller, name: str) -> list[inspect.Parameter]:
    """Return what a method is called with; of one that takes anything, what that of its base is called with."""
    found: list[inspect.Parameter] = []
    for owner in type(law).__mro__:
        if name in vars(owner):
            bound = getattr(owner, name).__get__(law) if inspect.isfunction(vars(owner)[name]) else getattr(law, name)
            found = list(inspect.signature(bound).parameters.values())
            if all(each.kind is each.POSITIONAL_OR_KEYWORD for each in found):
                return found
    return [each for each in found if each.kind is each.POSITIONAL_OR_KEYWORD]
