"""How the samples of a run change with gains: the tangents of a loop in C, carried along with it."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi
import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.compilation import loop_texts, tangent_texts
from phcontrol.compilation.c_code import Branch, ways
from phcontrol.compilation.cache import compiled
from phcontrol.compilation.compiled_loop import EXPLICIT, CompiledLoop, Plan, room
from phcontrol.compilation.eigenvalues import written_out
from phcontrol.compilation.errors import CompilationError
from phcontrol.compilation.lanes import LANES, prelude
from phcontrol.compilation.loop_parts import Part
from phcontrol.compilation.tracing import simplifying

_VECTOR = ctypes.POINTER(ctypes.c_double)
_SIGNALS = ctypes.POINTER(_VECTOR)
_INTEGER = ctypes.POINTER(ctypes.c_longlong)


class LoopTangents:
    """The derivatives of the states and torques of a run with respect to gains, by forward sensitivities.

    The integrator's own step is differentiated, stage by stage, and so is a torque that is held: what comes out is the
    derivative of the samples as they are simulated, and not an approximation of that of the differential equation.
    Where a torque is clipped, it does not change. A direction in which gains change goes on in each lane.

    Args:
        loop: in C, without sensors.

    Raises:
        CompilationError: a sensor shows the law what it needs: what it shows changes in jumps.
    """

    def __init__(self, loop: CompiledLoop) -> None:
        if loop.senses:
            raise CompilationError("a sensor shows the law what it needs, and is not differentiated")
        self._loop = loop

    @property
    def source(self) -> str:
        """The C file."""
        loop, facts = self._loop, self._loop.facts
        place, measure = 0, []
        for name, size in loop.measured:
            measure.append(tangent_texts.MEASURE[name].format(place=place))
            place += size
        texts = loop_texts.DECLARATIONS + tangent_texts.FIELD
        rest = texts.format(**facts, numbers=loop.size, tangent_measure="\n  ".join(measure))
        parts = [_with_tangents(part, loop.rows, int(facts["measured_room"]), loop.size) for part in loop.parts]
        return "\n".join(
            [prelude(True), *(ways(one.name, one.inputs, list(one.ways), True).text for one in parts), rest]
        )

    @lazy
    def _function(self) -> Any:
        return _loaded(compiled(self.source, self._loop.compiler, native=True, accept=_loaded))

    def sums(
        self,
        plan: Plan,
        numbers: Array,
        slopes: Sequence[Array],
        starts: Sequence[Array],
        states: Array,
        weights: Array,
        limit: Array,
        steady: Array,
        table: Array,
    ) -> Array:
        """Return, for each direction, the sum over a run's samples of weights times their derivatives.

        Args:
            plan: how it was simulated.
            numbers: of the loop, shape (p,).
            slopes: how they change, shape (p,) for each direction.
            starts: how the first state changes, shape (y,) likewise.
            states: of the run, shape (steps + 1, y).
            weights: of states, then of torques, shape (steps + 1, y + n).
            limit: of torques, shape (n,); inf for none.
            steady: the force that is constant, shape (n,).
            table: the forces over time (``signals_of``).

        Raises:
            CompilationError: the integrator is implicit, a branch is not compiled, or a derivative is not finite.
        """
        if plan.method not in EXPLICIT:
            raise CompilationError(f"steps of {plan.method} are not differentiated")
        held = [room(self._loop.n, lanes=LANES) for _ in range(2)]
        for array, values in zip(held, (limit, steady), strict=True):
            array[:] = values[:, None]
        rows = [np.ascontiguousarray(array, dtype=np.float64) for array in (states, weights)]
        forces = np.ascontiguousarray(table)
        found: list[float] = []
        for first in range(0, len(slopes), LANES):
            part = slice(first, first + LANES)
            some = self._block(plan, numbers, slopes[part], starts[part], held, forces, rows)
            found += list(some[: len(slopes[part])])
        return np.array(found)

    def _block(
        self,
        plan: Plan,
        numbers: Array,
        slopes: Sequence[Array],
        starts: Sequence[Array],
        held: Sequence[Array],
        forces: Array,
        rows: Sequence[Array],
    ) -> Array:
        """Return the sums of as many directions as there are lanes at most."""
        loop = self._loop
        both, start = room(2 * loop.size, lanes=LANES), room(loop.rows, lanes=LANES)
        both[: loop.size] = numbers[:, None]
        for lane, (slope, begun) in enumerate(zip(slopes, starts, strict=True)):
            both[loop.size :, lane], start[:, lane] = slope, begun
        along = room(1, lanes=LANES)
        signals = (_VECTOR * LANES)(*[forces.ctypes.data_as(_VECTOR)] * LANES) if forces.size else None
        status, reached = ctypes.c_longlong(), ctypes.c_longlong()
        self._function(
            plan.steps, plan.dt, plan.stride, plan.period, EXPLICIT.index(plan.method),
            *(array.ctypes.data_as(_VECTOR) for array in (both, *held)), signals,
            *(array.ctypes.data_as(_VECTOR) for array in (*rows, start, along)),
            ctypes.byref(status), ctypes.byref(reached),
        )  # fmt: skip
        if status.value:
            what = "it takes a branch that is not compiled" if status.value == 1 else "a derivative is not finite"
            raise CompilationError(f"at t = {reached.value * plan.dt:g} s {what}")
        found: Array = along[0]
        return found


def _with_tangents(part: Part, states: int, measured: int, numbers: int) -> Part:
    """Return a function whose outputs are followed by their tangents, as their inputs are (``tangent_texts``)."""
    t, q, v, s, m, p = part.inputs
    shown = m.numel() if part.name in ("plant", "total", "under_limits") else measured
    counts = part.name in ("law", "under_limits")  # whose numbers change with gains; nothing else's do
    behind = [(q, states), (v, states), (s, states), (m, shown), (p, numbers if counts else p.numel())]
    inputs, seeds = [t], []
    for vector, offset in behind:
        between = casadi.SX.sym("unused", offset - vector.numel())
        seed = casadi.SX.sym("d", vector.numel())
        inputs.append(casadi.vertcat(vector, between, seed))
        seeds.append(seed)
    if not counts:
        inputs[5], seeds[4] = p, casadi.SX(p.numel(), 1)
    variables, direction = casadi.vertcat(q, v, s, m, p), casadi.vertcat(*seeds)
    made = []
    for way in part.ways:
        outputs = written_out(casadi.vertcat(casadi.SX(0, 1), *way.outputs))
        guards = casadi.vertsplit(written_out(casadi.vertcat(casadi.SX(0, 1), *way.guards))) if way.guards else []
        with simplifying():
            slope = casadi.densify(casadi.jtimes(outputs, variables, direction))
        made.append(Branch(guards, [*casadi.vertsplit(outputs), *casadi.vertsplit(slope)] if outputs.numel() else []))
    return Part(part.name, inputs, made)


def _loaded(library: Path) -> Any:
    """Return the function of a library that carries tangents."""
    try:
        found = ctypes.CDLL(str(library)).phcontrol_tangents
    except (OSError, AttributeError) as error:
        raise CompilationError(f"{library} cannot be loaded: {error}") from error
    count, number = ctypes.c_long, ctypes.c_double
    found.restype = None
    found.argtypes = [
        count, number, count, number, ctypes.c_int, *[_VECTOR] * 3, _SIGNALS, *[_VECTOR] * 4, _INTEGER, _INTEGER,
    ]  # fmt: skip
    return found
