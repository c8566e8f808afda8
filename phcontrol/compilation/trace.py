"""A law written down as expressions: one trace for each way that its branches go."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import casadi
import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.compilation.eigenvalues import Eigenvalues
from phcontrol.compilation.errors import NotTraceableError
from phcontrol.compilation.law_inputs import NO_BODIES, Bodies, law_numbers, system_with_inputs, with_inputs
from phcontrol.compilation.symbol import Guards, Symbol
from phcontrol.compilation.traced_state import TracedState, traced_system
from phcontrol.compilation.tracing import classes_of, refusal, tracing
from phcontrol.compilation.ways import Entries, guarded_ways
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import Measured


class Instant(NamedTuple):
    """What a law is asked about: a time, a state of the arm and its own, and what is measured."""

    time: float
    position: Array
    velocity: Array
    state: Array
    measured: Measured


class Layout(NamedTuple):
    """Lengths of the inputs and outputs of a compiled function."""

    joints: int
    state: int
    measured: tuple[tuple[str, int], ...]
    """Names and lengths of what the law needs measured."""
    numbers: int
    """Gains, goals and tables."""

    @property
    def measured_size(self) -> int:
        """Length of all that is measured."""
        return sum(size for _, size in self.measured)


class Trace(NamedTuple):
    """One way through a law."""

    guards: list[Any]
    """Expressions that are all 1 where it is the law's way."""
    torque: list[Any]
    """Expressions, or floats."""
    rate: list[Any]
    """Of the law's own state, likewise."""
    blocks: Sequence[Eigenvalues] = ()
    """Decompositions of whose results these are made: kept, since expressions know their names only."""

    @property
    def outputs(self) -> list[Any]:
        """Torque and rate."""
        return [*self.torque, *self.rate]


class TracedLaw(NamedTuple):
    """A law as expressions of t, q, q̇, its state, what is measured, and its numbers."""

    layout: Layout
    inputs: list[Any]
    """(t, q, q̇, state, measured, numbers), vectors of ``casadi.SX``."""
    traces: list[Trace]
    numbers: Array
    """The law's own, shape (m,)."""


def layout_of(law: Controller, numbers: int) -> Layout:
    """Return the lengths of a law's inputs."""
    sizes = {"external_force": law.system.n, "total_force": law.system.n, "features": 3}
    return Layout(law.system.n, law.state_size, tuple((name, sizes[name]) for name in law.needs), numbers)


def trace_law(law: Controller, instants: list[Instant], *, inertias: Bodies = NO_BODIES) -> TracedLaw:
    """Return a law as expressions, traced the way that it takes at each of some instants, at most ``VARIANTS`` ways.

    The inertias of the bodies in ``inertias`` are inputs too.

    Raises NotTraceableError, naming the line, when it cannot be traced at any of them.
    """
    numbers = law_numbers(law, inertias)
    layout = layout_of(law, numbers.size)
    inputs = _inputs(layout)
    samples = (values_of(layout, instant, numbers) for instant in instants)
    traces = guarded_ways(law.name, inputs, samples, lambda values: _traced(law, layout, inputs, values, inertias))
    return TracedLaw(layout, inputs, traces, numbers)


class TracedRate(NamedTuple):
    """The rate of a law's own state where its torque is changed, as expressions of what a law reads.

    What is measured is followed by the rate of the law's own state and by the change of its torque.
    """

    inputs: list[Any]
    """(t, q, q̇, state, (measured, rate, change), numbers), vectors of ``casadi.SX``."""
    traces: list[Trace]
    """Their torque is the change."""

    @property
    def is_unchanged(self) -> bool:
        """Whether it is the rate that was given, whatever the change is."""
        shown, rates = casadi.vertsplit(self.inputs[4]), [trace.rate for trace in self.traces]
        given = shown[-self.inputs[1].numel() - len(rates[0]) :]
        return all(casadi.is_equal(found, own) for rate in rates for found, own in zip(rate, given, strict=False))


def trace_rate_under_limits(
    law: Controller, asked: Iterable[tuple[Instant, Command]], *, inertias: Bodies = NO_BODIES
) -> TracedRate:
    """Return ``rate_under_limits`` of a law as expressions, traced as ``trace_law`` traces the law.

    Each entry of a command's torque is reduced by some part of it, or by none.

    Raises NotTraceableError, naming the line, when it cannot be traced at any of the instants.
    """
    numbers, generator = law_numbers(law, inertias), np.random.default_rng(0)
    layout = layout_of(law, numbers.size)
    inputs = _inputs(layout, layout.state + layout.joints)

    def sample(instant: Instant, command: Command) -> list[Array]:
        values = values_of(layout, instant, numbers)
        change = -command.torque * np.maximum(0.0, generator.uniform(-0.5, 1.0, layout.joints))
        values[4] = np.concatenate([values[4], command.state_rate, change])
        return values

    def ask(traced: Controller, t: Any, x: MechanicalState, state: Any, measured: Measured, beside: Any) -> Any:
        rate, change = beside[: layout.state], beside[layout.state :]
        return change, traced.rate_under_limits(t, x, state, rate, change, measured)

    name, samples = f"{law.name} under torque limits", (sample(instant, command) for instant, command in asked)
    traces = guarded_ways(name, inputs, samples, lambda values: _traced(law, layout, inputs, values, inertias, ask))
    return TracedRate(inputs, traces)


def values_of(layout: Layout, instant: Instant, numbers: Array) -> list[Array]:
    """Return the inputs of a compiled function at an instant."""
    measured = [np.asarray(getattr(instant.measured, name)) for name, _ in layout.measured]
    return [
        np.array([instant.time]), instant.position, instant.velocity, instant.state,
        np.concatenate([np.zeros(0), *measured]), numbers,
    ]  # fmt: skip


def _inputs(layout: Layout, more: int = 0) -> list[Any]:
    """Return the vectors of ``casadi.SX`` that a function reads, ``more`` entries behind what is measured."""
    names = {"t": 1, "q": layout.joints, "v": layout.joints, "s": layout.state, "m": layout.measured_size + more}
    return [casadi.SX.sym(name, size) for name, size in (names | {"p": layout.numbers}).items()]


Question = Callable[[Controller, Any, MechanicalState, Any, Measured, Any], Any]
"""Of a law in symbols, t, x, its state, what is measured, and the entries behind that: a torque and a rate."""


def _command(law: Controller, t: Any, x: MechanicalState, state: Any, measured: Measured, beside: Any) -> Any:
    return law.evaluate(t, x, state, measured)


def _traced(
    law: Controller,
    layout: Layout,
    inputs: list[Any],
    values: list[Array],
    inertias: Bodies,
    ask: Question = _command,
) -> Trace:
    guards = Guards()
    entries = Entries(inputs, values, guards)
    system = traced_system(law.system)
    traced = with_inputs(law, system, entries.make)
    system_with_inputs(system, entries.make, inertias)
    position, velocity, state = entries.of(1), entries.of(2), entries.of(3)
    seen, start, shown = entries.of(4), 0, {}
    for name, size in layout.measured:
        shown[name] = seen[start : start + size]
        start += size
    before = dict(vars(traced))
    try:
        with tracing(classes_of(law, law.system.friction, law.system.potentials)):
            x: MechanicalState = TracedState(system, position, velocity)
            torque, rate = ask(traced, entries.of(0)[0], x, state, Measured(**shown), seen[start:])
    except Exception as error:  # whatever a law does that symbols cannot
        raise refusal(law.name, error) from error
    for name, value in vars(traced).items():
        if before.get(name, before) is not value and not isinstance(getattr(type(traced), name, None), lazy):
            raise NotTraceableError(
                f"{law.name} cannot be compiled: it keeps '{name}' between calls, outside its state"
            )
    if len(torque) != layout.joints or len(rate) != layout.state:
        raise NotTraceableError(f"{law.name} cannot be compiled: its command has lengths {len(torque)}, {len(rate)}")
    return Trace(guards.conditions, _expressions(torque), _expressions(rate), guards.blocks)


def _expressions(values: Any) -> list[Any]:
    return [value.expression if type(value) is Symbol else casadi.SX(float(value)) for value in values]
