"""Plant, law and what is around them as one loop in C: integrated, sampled and recorded there."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation import loop_texts
from phcontrol.compilation.c_code import ways
from phcontrol.compilation.cache import compiled
from phcontrol.compilation.compiler import Compiler
from phcontrol.compilation.errors import CompilationError
from phcontrol.compilation.instants import instants
from phcontrol.compilation.lanes import LANES, prelude
from phcontrol.compilation.law_inputs import (
    NO_BODIES,
    Bodies,
    law_numbers,
    structure_of,
    structure_of_things,
    system_structure,
)
from phcontrol.compilation.loop_parts import Part, arm_parts, observer_parts, surroundings_part
from phcontrol.compilation.trace import trace_law, trace_rate_under_limits
from phcontrol.compilation.watch import refuse_clocks_and_dice
from phcontrol.controllers.controller import Controller
from phcontrol.environments.body import Body
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.sensors.momentum_observer import MomentumObserver

METHODS = ("semi_implicit_euler", "rk4", "implicit_midpoint", "discrete_gradient")
"""The integrators that there are in C."""
EXPLICIT = METHODS[:2]
DONE, NOT_COMPILED, NOT_FINITE, NO_SOLUTION = 0, 1, 2, 3
"""What a run in C says: whether it came to its end, where a branch is not compiled, where it diverged, where an
implicit step was not found by iteration."""

TRACED = 48
"""At how many instants a law is traced."""
_VECTOR = ctypes.POINTER(ctypes.c_double)
_SIGNALS = ctypes.POINTER(_VECTOR)
_INTEGERS = ctypes.POINTER(ctypes.c_longlong)
_ALIGNED = 64  # bytes


class Arrangement(NamedTuple):
    """What is simulated: two arrangements with the same structure need one compilation."""

    plant: MechanicalSystem
    law: Controller
    """Interpreted; its own model may differ from the plant."""
    bodies: tuple[Body, ...] = ()
    traced: tuple[tuple[float, Any], ...] = ()
    """Factors and functions f_e(t, x) that are no table of signals."""
    observer: MomentumObserver | ForceSensor | None = None
    """What shows the law f_e. Of a force sensor all numbers are inputs (``felt_by``)."""
    implicit: bool = False
    """Whether implicit integrators are to run."""
    limited: bool = False
    """Whether the law's torque is clipped, and the law says what that does to the rate of its own state."""
    varied: Bodies = NO_BODIES
    """The bodies of plant, law's model and observer's model whose inertias are inputs."""

    @property
    def structure(self) -> list[Any]:
        """All of it that is code and no input."""
        law, varied = self.law, self.varied
        same = self.plant is law.system
        found = [structure_of(law, varied), same, varied, self.implicit, self.limited]
        found += [len(self.bodies), len(self.traced)]
        found.append(None if same else system_structure(self.plant, varied))
        found += structure_of_things((self.bodies, self.traced))
        if isinstance(self.observer, MomentumObserver):
            found += [structure_of_things(self.observer), self.observer.period]  # a block has one period for all
            found.append(system_structure(self.observer.system, varied))
        elif self.observer is not None:
            found.append("force sensor")
        return found


class CompiledLoop:
    """An arrangement in C. Raises CompilationError or NotTraceableError when it cannot be made.

    Args:
        arrangement: plant, law and what is around.
        span: how long it is going to run [s], for functions of time.
        compiler: makes it.
    """

    def __init__(self, arrangement: Arrangement, span: float, compiler: Compiler) -> None:
        plant, law = arrangement.plant, arrangement.law
        observer = arrangement.observer
        shown = () if observer is None else (observer.quantity,)
        truth = [name for name in law.needs if name not in shown]
        if any(name not in loop_texts.MEASURE for name in truth) or (observer is not None and truth):
            raise CompilationError(f"{law.name} needs more measured than a loop in C gives it")
        refuse_clocks_and_dice(law, law.name)
        refuse_clocks_and_dice((arrangement.bodies, arrangement.traced), "what acts on the arm")
        self.n, self.compiler = plant.n, compiler
        self.rows = 2 * plant.n + law.state_size + sum(body.state_size for body in arrangement.bodies)
        """Length of a state."""
        self.carry = 7 * plant.n + law.state_size + 1
        self.structure = arrangement.structure
        varied = arrangement.varied
        asked = list(instants(law, TRACED, seed=1))
        traced = trace_law(law, [instant for instant, _ in asked], inertias=varied)
        self.parts = [Part("law", traced.inputs, traced.traces)]  # type: ignore[arg-type]
        """The law, the arm and what is around, as expressions."""
        rate = trace_rate_under_limits(law, asked, inertias=varied) if arrangement.limited else None
        if rate is not None and not rate.is_unchanged:
            alone = [trace._replace(torque=[]) for trace in rate.traces]
            self.parts.append(Part("under_limits", rate.inputs, alone))  # type: ignore[arg-type]
        arm, arm_numbers = arm_parts(plant, varied, total="total_force" in truth, implicit=arrangement.implicit)
        self.parts += arm
        sizes = [traced.numbers.size, arm_numbers.size]
        around, watched = np.zeros(0), np.zeros(0)
        if arrangement.bodies or arrangement.traced:
            one, around = surroundings_part(plant, arrangement.bodies, arrangement.traced, span)
            self.parts.append(one)
        if isinstance(observer, MomentumObserver):
            own, watched = observer_parts(observer, plant, varied)
            self.parts += own
        starts = np.cumsum([0, *sizes, around.size, watched.size])
        self.size = int(starts[-1])
        """How many numbers are inputs."""
        self.measured = traced.layout.measured
        """Names and lengths of what the law is shown."""
        self.senses = observer is not None
        """Whether a sensor shows it."""
        place, measure = 0, []
        for name, size in traced.layout.measured:
            measure.append(loop_texts.MEASURE["shown" if name in shown else name].format(place=place))
            place += size
        self.facts = {
            "joints": plant.n, "states": law.state_size, "bodies": self.rows - 2 * plant.n - law.state_size,
            "plant_numbers": starts[1], "around_numbers": starts[2], "observer_numbers": starts[3],
            "has_around": int("around" in [one.name for one in self.parts]), "has_sensor": int(observer is not None),
            "has_implicit": int(arrangement.implicit), "measured_room": max(1, place), "measure": "\n  ".join(measure),
            "has_limits": int("under_limits" in [one.name for one in self.parts]), "measured": place,
        }  # fmt: skip
        """What the texts in C are filled in with."""
        facts = self.facts
        self._text = (loop_texts.DECLARATIONS + loop_texts.HEAD).format(**facts)
        if observer is not None:
            self._text += loop_texts.SENSE if isinstance(observer, MomentumObserver) else loop_texts.FEEL
        self._text += loop_texts.IMPLICIT if arrangement.implicit else ""
        self._text += loop_texts.RUN.format(**facts)
        self._libraries: dict[bool, Any] = {}
        self.checked: set[bool] = set()
        """Of which libraries (with lanes or without) it was seen that they are the interpreted loop."""

    def source(self, lanes: bool) -> str:
        """Return the C file."""
        parts = [ways(one.name, one.inputs, list(one.ways), lanes).text for one in self.parts]
        return "\n".join([prelude(lanes), *parts, self._text])

    def library(self, lanes: bool) -> Any:
        """Return the loop as it was loaded: for one run at a time, or for ``LANES`` at once."""
        found = self._libraries.get(lanes)
        if found is None:
            path = compiled(self.source(lanes), self.compiler, native=lanes, accept=_loaded)
            found = self._libraries[lanes] = _loaded(path)
        return found

    def block(self, numbers: Sequence[Array], lanes: bool) -> Block:
        """Return room for runs with these numbers: one, or as many as there are lanes."""
        return Block(self, self.library(lanes), numbers, LANES if lanes else 1)


class Block:
    """Runs that go on together, one in each lane: their numbers, and where they stand.

    Arrays hold the lanes last. What is set before ``start``: ``limit``, ``steady``, ``first`` and ``signals``.
    """

    def __init__(self, loop: CompiledLoop, library: Any, numbers: Sequence[Array], lanes: int) -> None:
        self._library, self._n, self.lanes = library, loop.n, lanes
        self._numbers = room(loop.size, lanes=lanes)
        for lane, values in enumerate(numbers):
            if values.size != loop.size:
                raise CompilationError(f"{values.size} numbers were found where {loop.size} were compiled")
            self._numbers[:, lane] = values
        self.limit = room(loop.n, lanes=lanes)
        """Largest torques, inf for none, shape (n, lanes) [N·m]."""
        self.limit[:] = np.inf
        self.steady = room(loop.n, lanes=lanes)
        """Forces that are constant, shape (n, lanes) [N·m]."""
        self._signals: list[Array] = []
        self._tables: Any = None
        self._felt: list[Array] = []
        self._sensed: Any = None
        self._joints: list[Array] = []
        self._read: Any = None
        self._carry = room(loop.carry, lanes=lanes)
        self.first = self._carry[: loop.n]
        """Torques that act until the first that is ordered does, shape (n, lanes) [N·m]."""
        self._line = room(0, lanes=lanes)
        self.status: Any = np.zeros(lanes, dtype=np.int64)
        """DONE for a run that goes on, or what it ended by, shape (lanes,)."""
        self.reached: Any = np.zeros(lanes, dtype=np.int64)
        """The last sample of each, shape (lanes,)."""
        self.ends = room(loop.rows, lanes=lanes)
        """The states there, shape (y, lanes)."""

    def set_signals(self, tables: Sequence[Array]) -> None:
        """Set the forces over time, a table for each lane (``signals_of``)."""
        self._signals = [np.ascontiguousarray(table) for table in tables]
        pointers: list[Any] = [table.ctypes.data_as(_VECTOR) if table.size else None for table in self._signals]
        pointers += [None] * (self.lanes - len(pointers))
        self._tables = (_VECTOR * self.lanes)(*pointers) if any(table.size for table in self._signals) else None

    def set_felt(self, rows: Sequence[Array]) -> None:
        """Set the force sensors, a row for each lane (``felt_by``). A run writes into them."""
        self._felt, self._sensed = self._written(rows)

    def set_joints(self, rows: Sequence[Array]) -> None:
        """Set the joint sensors, a row for each lane (``joint_readings``). A run writes into them."""
        self._joints, self._read = self._written(rows)

    def _written(self, rows: Sequence[Array]) -> tuple[list[Array], Any]:
        """Return rows of the lanes that a run writes into, and pointers to them."""
        own = [np.array(row) for row in rows]
        return own, (_VECTOR * self.lanes)(*(row.ctypes.data_as(_VECTOR) for row in own))

    def field(self, t: float, y: Array) -> tuple[Array, Array, Array]:
        """Return ẏ, torque and force at states y, shapes (…, lanes); ``status`` says where they are any."""
        rate, torque, force = (room(size, lanes=self.lanes) for size in (len(y), self._n, self._n))
        state = room(len(y), lanes=self.lanes)  # begins where a vector may
        state[:] = y
        self._library.phcontrol_field(
            t, *(_pointer(array) for array in (state, self._numbers, self.limit, self.steady)), self._tables,
            *(_pointer(array) for array in (torque, force, rate)), self.status.ctypes.data_as(_INTEGERS),
        )  # fmt: skip
        return rate, torque, force

    def advance(self, plan: Plan, first: int, last: int, record: Record) -> None:
        """Simulate samples first to last into the record, whose first row is sample first.

        Its states there are given; of those a row more is made, for the sample after. A record of fewer rows has the
        last of them, in turn. The lock of the interpreter is free meanwhile.
        """
        places = plan.late // plan.stride + 1 if plan.stride else 0
        if first == 0:
            self._line = room(places * self._n, lanes=self.lanes)
        self._library.phcontrol_run(
            first, last, len(record.torques), plan.steps, plan.dt, plan.stride, plan.period, plan.late, plan.due,
            METHODS.index(plan.method), *(_pointer(array) for array in (self._numbers, self.limit, self.steady)),
            self._tables, self._sensed, self._read, _pointer(self._carry), _pointer(self._line),
            *(_pointer(array) for array in (*record, self.ends)),
            *(array.ctypes.data_as(_INTEGERS) for array in (self.status, self.reached)),
        )  # fmt: skip


class Plan(NamedTuple):
    """How runs are simulated."""

    steps: int
    dt: float
    """[s]."""
    method: str
    stride: int = 0
    """Steps in a control period; 0 for continuous control."""
    period: float = 0.0
    """Of control [s]."""
    due: int = 1
    """Steps between two updates of the observer."""
    late: int = 0
    """Steps from ordering a torque to its acting."""


class Record(NamedTuple):
    """Samples of runs: rows, what is recorded, lanes."""

    states: Array
    """Shape (rows + 1, y, lanes)."""
    torques: Array
    """Shape (rows, n, lanes)."""
    forces: Array
    """Shape (rows, n, lanes)."""
    readings: Array
    """What an observer shows, shape (rows, n, lanes); without rows where there is none."""
    joints: Array
    """What a joint sensor shows of q and q̇, shape (rows, 2n, lanes); without rows where there is none."""

    @classmethod
    def empty(cls, loop: CompiledLoop, rows: int, lanes: int, observed: bool, joints: bool = False) -> Record:
        """Return room for some samples."""
        return cls(*(room(*size, lanes=lanes) for size in cls.sizes(loop, rows, observed, joints)))

    @staticmethod
    def sizes(loop: CompiledLoop, rows: int, observed: bool, joints: bool) -> tuple[tuple[int, int], ...]:
        """Return the shapes for some samples, without lanes."""
        return (
            (rows + 1, loop.rows), (rows, loop.n), (rows, loop.n),
            (rows if observed else 0, loop.n), (rows if joints else 0, 2 * loop.n),
        )  # fmt: skip


def room(*shape: int, lanes: int) -> Array:
    """Return zeros of a shape and lanes, that begin where a vector may."""
    count = int(np.prod(shape)) * lanes
    plain = np.zeros(count + _ALIGNED // 8)
    start = (-plain.ctypes.data % _ALIGNED) // 8
    return plain[start : start + count].reshape(*shape, lanes)


def _loaded(library: Path) -> Any:
    """Return a library that has a loop in it."""
    try:
        found = ctypes.CDLL(str(library))
        run, field = found.phcontrol_run, found.phcontrol_field
    except (OSError, AttributeError) as error:
        raise CompilationError(f"{library} cannot be loaded: {error}") from error
    count, number = ctypes.c_long, ctypes.c_double
    run.restype = field.restype = None
    run.argtypes = [
        *[count] * 4, number, count, number, count, count, ctypes.c_int, *[_VECTOR] * 3, *[_SIGNALS] * 3,
        *[_VECTOR] * 8, _INTEGERS, _INTEGERS,
    ]  # fmt: skip
    field.argtypes = [number, *[_VECTOR] * 4, _SIGNALS, *[_VECTOR] * 3, _INTEGERS]
    return found


def _pointer(array: Array) -> Any:
    if not array.flags.c_contiguous or array.dtype != np.float64:
        raise CompilationError("a loop in C takes contiguous arrays of float64")
    return array.ctypes.data_as(_VECTOR)


def numbers_of_arrangement(arrangement: Arrangement) -> Array:
    """Return all numbers of an arrangement that are inputs, in their order."""
    from phcontrol.compilation.law_inputs import numbers_of, system_numbers

    varied, observer = arrangement.varied, arrangement.observer
    found = [law_numbers(arrangement.law, varied), system_numbers(arrangement.plant, varied)]
    found.append(numbers_of((arrangement.bodies, arrangement.traced)))
    if isinstance(observer, MomentumObserver):
        found += [numbers_of(observer), system_numbers(observer.system, varied)]
    return np.concatenate(found)
