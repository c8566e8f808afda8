"""Expressions with their derivatives, along the branches of one sample."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.compilation.eigenvalues import written_out
from phcontrol.compilation.errors import CompilationError
from phcontrol.compilation.symbol import Guards, Symbol, SymbolArray, symbols
from phcontrol.compilation.trace import Instant, trace_law
from phcontrol.compilation.traced_state import TracedState, traced_system
from phcontrol.compilation.tracing import classes_of, refusal, simplifying, tracing
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import measure_truly
from phcontrol.vision.scene import Scene


class Differentiated:
    """Functions of some vectors, and of parameters that keep their values, with their derivatives.

    Args:
        inputs: vectors of ``casadi.SX``.
        parameters: a vector of ``casadi.SX``.
        values: of the parameters.
        guards: expressions that are all 1 where the branches are right.
        outputs: scalar expressions.
    """

    def __init__(self, inputs: list[Any], parameters: Any, values: Array, guards: list[Any], outputs: list[Any]):
        self._inputs, self._parameters, self._values = inputs, parameters, values
        self._sizes = [entry.numel() for entry in inputs]
        self._outputs = written_out(casadi.vertcat(casadi.SX(0, 1), *outputs))
        self._guards = casadi.Function("g", [*inputs, parameters], [written_out(casadi.vertcat(casadi.SX(1), *guards))])

    def holds(self, inputs: list[Array]) -> bool:
        """Whether the branches are those that are taken at some inputs."""
        return bool(np.array(self._guards(*inputs, self._values)).all())

    def slopes(self, inputs: list[Array]) -> list[Array]:
        """Return the derivative with respect to each input. Raises CompilationError where there is none."""
        whole = self._evaluated(self._by_inputs, inputs)
        return list(np.split(whole, np.cumsum(self._sizes)[:-1], axis=1))

    def parameters(self, inputs: list[Array]) -> Array:
        """Return the derivative with respect to the parameters. Raises CompilationError where there is none."""
        return self._evaluated(self._by_parameters, inputs)

    @lazy
    def _by_inputs(self) -> Any:
        return self._made(casadi.vertcat(*self._inputs))

    @lazy
    def _by_parameters(self) -> Any:
        return self._made(self._parameters)

    def _made(self, variables: Any) -> Any:
        with simplifying():
            slope = casadi.densify(casadi.jacobian(self._outputs, variables))
            return casadi.Function("J", [*self._inputs, self._parameters], [casadi.cse(slope)])

    def _evaluated(self, function: Any, inputs: list[Array]) -> Array:
        found: Array = np.asarray(function(*inputs, self._values).full(), dtype=np.float64)
        if not np.isfinite(found).all():
            raise CompilationError("there is no derivative there: it is not finite")
        return found


def differentiated_law(law: Controller, instant: Instant) -> Differentiated:
    """Return torque and rate of the state of a law, as functions of (t, q, q̇, state, measured) and its numbers."""
    traced = trace_law(law, [instant])
    (trace,) = traced.traces
    *inputs, numbers = traced.inputs
    return Differentiated(inputs, numbers, traced.numbers, trace.guards, [*trace.torque, *trace.rate])


def differentiated_plant(
    plant: MechanicalSystem, law: Controller, scene: Scene | None, q: Array, v: Array, torque: Array, force: Array
) -> Differentiated:
    """Return q̈ and what the law needs measured, as functions of (q, q̇, u, f_e) and the plant's inertias."""
    system, guards = traced_system(plant), Guards()
    inertias = np.array(system.arm.inertial_numbers())
    samples = [q, v, torque, force, inertias]
    inputs = [casadi.SX.sym(name, len(values)) for name, values in zip("qvufm", samples, strict=True)]

    def entries(which: int) -> SymbolArray:
        pairs = zip(casadi.vertsplit(inputs[which]), samples[which], strict=True)
        return symbols([Symbol(part, float(value), guards) for part, value in pairs])

    try:
        with tracing(classes_of(law, plant.friction, plant.potentials, scene)):
            system.arm = system.arm.with_inertial_numbers(entries(4))
            x = TracedState(system, entries(0), entries(1))
            outside = entries(3)
            found = [*x.acceleration(entries(2), outside)]
            for shown in measure_truly(x, outside, law.needs, scene):
                found += [] if shown is None else list(shown)
    except Exception as error:  # whatever a plant does that symbols cannot
        raise refusal(f"the plant {plant.robot.name}", error) from error
    outputs = [entry.expression if type(entry) is Symbol else casadi.SX(float(entry)) for entry in found]
    return Differentiated(inputs[:4], inputs[4], inertias, guards.conditions, outputs)
