"""What a closed loop computes beside its law, traced: the arm, what it touches, and a momentum observer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import casadi
import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.c_code import Branch
from phcontrol.compilation.errors import CompilationError
from phcontrol.compilation.law_inputs import (
    Bodies,
    numbers_of,
    system_numbers,
    system_with_inputs,
    thing_with_inputs,
)
from phcontrol.compilation.symbol import Guards, Symbol, symbols
from phcontrol.compilation.traced_state import TracedState, TracedSystem, traced_system
from phcontrol.compilation.tracing import classes_of, refusal, tracing
from phcontrol.compilation.ways import Entries, guarded_ways
from phcontrol.environments.body import Body
from phcontrol.mechanics.system import MechanicalSystem

_SAMPLES = 12  # at which an arm is traced
_TITLES = {"around": "what acts on the arm", "begin": "the observer", "observe": "the observer"}
_TRIES = 400  # random postures, to find one that touches a body


class Part(NamedTuple):
    """A function of t, q, q̇, a state s, something measured m, and numbers p, one way or more."""

    name: str
    inputs: list[Any]
    ways: Sequence[Branch]


class Sizes(NamedTuple):
    """Lengths of the inputs of a part."""

    joints: int
    state: int = 0
    measured: int = 0


Compute = Callable[[Any, Any, Any, Any, Any, Callable[[list[float]], list[Any]]], Iterable[Any]]
"""Of t, q, q̇, s, m and a maker of inputs: the outputs."""


def part(
    name: str, sizes: Sizes, numbers: Array, samples: Iterable[list[Array]], compute: Compute, things: Sequence[Any]
) -> Part:
    """Return a function as expressions, traced the way that it goes at each of some samples (t, q, q̇, s, m).

    Raises NotTraceableError, naming the line, where it cannot be traced at any of them.
    """
    lengths = (1, sizes.joints, sizes.joints, sizes.state, sizes.measured, numbers.size)
    inputs = [casadi.SX.sym(letter, size) for letter, size in zip("tqvsmp", lengths, strict=True)]
    title = _TITLES.get(name, "the plant")
    sampled = ([*sample, numbers] for sample in samples)
    ways = guarded_ways(title, inputs, sampled, lambda values: _way(title, inputs, values, compute, things))
    return Part(name, inputs, ways)


def _way(title: str, inputs: list[Any], values: list[Array], compute: Compute, things: Sequence[Any]) -> Branch:
    guards = Guards()
    entries = Entries(inputs, values, guards)
    try:
        with tracing(classes_of(*things)):
            q, v, s, m = (entries.of(which) for which in range(1, 5))
            found = list(compute(entries.of(0)[0], q, v, s, m, entries.make))
    except Exception as error:  # whatever somebody's function does that symbols cannot
        raise refusal(title, error) from error
    outputs = [entry.expression if type(entry) is Symbol else casadi.SX(float(entry)) for entry in found]
    return Branch(guards.conditions, outputs)


def arm_parts(plant: MechanicalSystem, bodies: Bodies, *, total: bool, implicit: bool) -> tuple[list[Part], Array]:
    """Return what an arm does, and the numbers of it that are inputs: its acceleration, and what else is asked for.

    Args:
        plant: the arm.
        bodies: whose inertias are inputs.
        total: whether its total force is measured.
        implicit: whether implicit integrators are to run on it.
    """
    n, numbers, generator = plant.n, system_numbers(plant, bodies), np.random.default_rng(0)

    def samples(measured: int) -> list[list[Array]]:
        draw = generator.normal
        return [
            [np.zeros(1), plant.robot.random_position(generator), draw(size=n), np.zeros(0), draw(size=measured)]
            for _ in range(_SAMPLES)
        ]

    def of(name: str, measured: int, ask: Callable[[Any, Any, Any, Any], Iterable[Any]]) -> Part:
        def compute(t: Any, q: Any, v: Any, s: Any, m: Any, make: Any) -> Iterable[Any]:
            twin = traced_system(plant)
            system_with_inputs(twin, make, bodies)
            return ask(twin, q, v, m)

        things = (plant.friction, plant.potentials)
        return part(name, Sizes(n, measured=measured), numbers, samples(measured), compute, things)

    parts = [of("plant", 2 * n, lambda arm, q, v, m: TracedState(arm, q, v).acceleration(m[:n], m[n:]))]
    if total:
        parts.append(of("total", n, lambda arm, q, v, m: TracedState(arm, q, v).total_force(m)))
    if implicit:
        parts += [
            of("momenta", 0, lambda arm, q, v, m: TracedState(arm, q, v).momentum),
            of("velocity", 0, lambda arm, q, p, m: _velocity(arm, q, p)),
            of("forces", 2 * n, lambda arm, q, v, m: TracedState(arm, q, v).momentum_rate(m[:n], m[n:])),
            of("energy", 0, lambda arm, q, p, m: [TracedState(arm, q, _velocity(arm, q, p)).energy]),
            of("slopes", 0, _slopes),
        ]
    return parts, numbers


def _velocity(arm: TracedSystem, q: Any, p: Any) -> Any:
    x = TracedState(arm, q, p)
    return x.solve_factor_transposed(x.solve_factor(p))


def _slopes(arm: TracedSystem, q: Any, v: Any, m: Any) -> list[Any]:
    """Return ∂H/∂q at constant p, and D."""
    x = TracedState(arm, q, v)
    return [*(x.potential_gradient - v.dot(x.coriolis_matrix)), *symbols(x.damping_matrix).ravel()]


def surroundings_part(
    plant: MechanicalSystem, bodies: Sequence[Body], traced: Sequence[tuple[float, Any]], span: float
) -> tuple[Part, Array]:
    """Return the force of bodies and of functions of time and state on an arm, with the rates of the bodies' states.

    Args:
        plant: the arm.
        bodies: what it touches.
        traced: factors and functions f_e(t, x).
        span: until when the functions are asked [s].
    """
    for body in bodies:
        if not getattr(body.geometry, "has_closed_form", True):
            raise CompilationError("contact with a shape that is neither plane nor sphere: not compiled yet")
    things = (tuple(bodies), tuple(traced))
    sizes = [body.state_size for body in bodies]

    def compute(t: Any, q: Any, v: Any, s: Any, m: Any, make: Any) -> Iterable[Any]:
        touched, functions = thing_with_inputs(things, make)
        x = TracedState(traced_system(plant), q, v)
        force, start = symbols(np.zeros(plant.n)), 0
        rates: list[Any] = []
        for factor, function in functions:
            found = symbols(function(t, x))
            if found.shape != (plant.n,):
                raise CompilationError(f"a disturbance has shape {found.shape} for {plant.n} joints")
            force = force + factor * found
        for body, size in zip(touched, sizes, strict=True):
            touch = body.touch(x, s[start : start + size])
            force, rates, start = force + touch.force, [*rates, *touch.state_rate], start + size
        return [*force, *rates]

    numbers = numbers_of(things)
    samples = _around(plant, bodies, span)
    return part("around", Sizes(plant.n, state=sum(sizes)), numbers, samples, compute, [things]), numbers


def _around(plant: MechanicalSystem, bodies: Sequence[Body], span: float) -> list[list[Array]]:
    """Return samples: times all over a run, postures that are free, and for each body one that touches it."""
    generator = np.random.default_rng(0)
    rest = np.concatenate([np.zeros(0), *(body.initial_state() for body in bodies)])
    touching = set(range(len(bodies)))
    samples = []
    for k in range(_TRIES):
        q, v = plant.robot.random_position(generator), generator.normal(size=plant.n)
        met = {i for i in touching if bodies[i].geometry.gap(plant.at(q)).distance < 0.0}
        touching -= met
        if met or k < 2 * _SAMPLES:
            time = generator.uniform(0.0, span) if k else 0.0
            samples.append([np.array([time]), q, v, rest + 1e-3 * generator.normal(size=rest.size), np.zeros(0)])
    return samples


def observer_parts(observer: Any, plant: MechanicalSystem, bodies: Bodies) -> tuple[list[Part], Array]:
    """Return how a momentum observer begins and goes on, and the numbers of it that are inputs."""
    system, n = observer.system, plant.n
    kind = type(observer.start(system.at(system.robot.home), np.zeros(n)))
    numbers = np.concatenate([numbers_of(observer), system_numbers(system, bodies)])

    def twin(make: Any) -> tuple[Any, TracedSystem]:
        own = traced_system(system)
        found = thing_with_inputs(observer, make, {id(system): own})
        system_with_inputs(own, make, bodies)
        return found, own

    def begin(t: Any, q: Any, v: Any, s: Any, m: Any, make: Any) -> Iterable[Any]:
        own, arm = twin(make)
        state = own.start(TracedState(arm, q, v), None)
        return [*state.momentum, *state.modeled]

    def observe(t: Any, q: Any, v: Any, s: Any, m: Any, make: Any) -> Iterable[Any]:
        own, arm = twin(make)
        state = kind(s[0], s[1 : n + 1], s[n + 1 : 2 * n + 1], s[2 * n + 1 :])
        found = own.update(state, t, TracedState(arm, q, v), None, m)
        return [found.time, *found.momentum, *found.modeled, *found.estimate]

    generator = np.random.default_rng(0)
    q, v = system.robot.random_position(generator), generator.normal(size=n)
    kept, torque = np.concatenate([[0.5], generator.normal(size=3 * n)]), generator.normal(size=n)
    things = (observer, system.friction, system.potentials)
    first = [np.zeros(1), q, v, np.zeros(0), np.zeros(0)]
    parts = [
        part("begin", Sizes(n), numbers, [first], begin, things),
        part("observe", Sizes(n, 3 * n + 1, n), numbers, [[np.ones(1), q, v, kept, torque]], observe, things),
    ]
    return parts, numbers
