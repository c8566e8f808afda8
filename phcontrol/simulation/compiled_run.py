"""Runs in C, where what is simulated can be compiled."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.compiled_law import TOLERANCE, CompiledLaw, need_casadi
from phcontrol.compilation.compiler import Compiler, find_compiler
from phcontrol.compilation.errors import CompilationError, CompilationWarning
from phcontrol.compilation.signals import Signals, signals_of
from phcontrol.controllers.controller import Controller
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.sensors.measured import Measured
from phcontrol.sensors.momentum_observer import MomentumObserver
from phcontrol.simulation.felt import felt_by, is_felt
from phcontrol.simulation.instruments import due_of
from phcontrol.simulation.joint_readings import joint_readings
from phcontrol.simulation.run import Run
from phcontrol.simulation.vector_field import ClosedLoop, Held

if TYPE_CHECKING:
    from phcontrol.compilation.compiled_loop import Arrangement, Block, CompiledLoop, Plan, Record

_CHECKED = 12  # random instants at which a loop is held against the interpreted one, beside those of its trace
_KEPT = 16  # loops that were made last
DIVERGED = 1e6
"""Of a state: beyond it bounds fail because numbers overflow."""
_LOOPS: list[CompiledLoop] = []


class Prepared(NamedTuple):
    """A closed loop in C: the code, its numbers, and the disturbance as signals."""

    loop: CompiledLoop
    numbers: Array
    signals: Signals


def arranged(
    loop: ClosedLoop, observer: MomentumObserver | ForceSensor | None, implicit: bool
) -> tuple[Arrangement, Signals]:
    """Return what a closed loop is for the compiler, and its disturbance. Raises CompilationError."""
    from phcontrol.compilation.compiled_loop import Arrangement

    law = loop.controller.interpreted if isinstance(loop.controller, CompiledLaw) else loop.controller
    signals = signals_of(loop.disturbance, loop.n)
    limited = loop.torque_limit is not None and _counts_limits(law)
    return Arrangement(loop.plant, law, loop.bodies, signals.traced, observer, implicit, limited), signals


def _counts_limits(law: Controller) -> bool:
    """Return whether a law says of its own what limits of the torque do to its state."""
    return law.state_size > 0 and type(law).rate_under_limits is not Controller.rate_under_limits


def obstacles(loop: ClosedLoop, others: dict[str, Any]) -> str:
    """Return what of a run is not compiled, in words; "" for nothing."""
    present = [name for name, value in others.items() if value is not None]
    if loop.controller.jumps:
        present.append("a law whose state jumps")
    if loop.scene is not None:
        present.append("a scene")
    return f"{', '.join(present)}: not compiled yet" if present else ""


def observer_among(run: Run) -> tuple[MomentumObserver | ForceSensor | None, bool]:
    """Return the sensor of f_e that is the only one and is compiled, and whether there is anything else."""
    sensors = run.sensors
    if not sensors:
        return None, sensors is not None
    if len(sensors) == 1 and (type(sensors[0]) is MomentumObserver or is_felt(sensors[0], run.loop.n)):
        return sensors[0], False
    return None, True


def compiler_found() -> Compiler:
    """Return the C compiler. Raises CompilationError where it, or CasADi, is missing."""
    need_casadi()
    compiler = find_compiler()
    if compiler is None:
        raise CompilationError("no C compiler was found")
    return compiler


def prepare(run: Run, others: dict[str, Any]) -> Prepared:
    """Return a run's closed loop in C.

    Args:
        run: what is simulated.
        others: what else was asked for, by name; what is not None is not compiled.

    Raises:
        CompilationError: it is not compiled; says why.
    """
    observer, more = observer_among(run)
    problem = obstacles(run.loop, others | {"sensors": True if more else None})
    if problem:
        raise CompilationError(problem)
    compiler = compiler_found()
    from phcontrol.compilation.compiled_loop import EXPLICIT, numbers_of_arrangement
    from phcontrol.compilation.law_inputs import remembering

    with remembering():
        arrangement, signals = arranged(run.loop, observer, run.integrator not in EXPLICIT)
        made = compiled_loop(arrangement, run, compiler)
        return Prepared(made, numbers_of_arrangement(arrangement), signals)


def prepared(run: Run, others: dict[str, Any]) -> Prepared | None:
    """Return what ``prepare`` does; None, with a warning that says why, where a run is simulated interpreted."""
    try:
        return prepare(run, others)
    except CompilationError as error:
        say_interpreted(str(error))
        return None


def say_interpreted(reason: str, level: int = 4) -> None:
    """Warn that a run is simulated interpreted, at the line of the caller so many levels up."""
    warnings.warn(f"the run is simulated interpreted: {reason}", CompilationWarning, stacklevel=level)


def compiled_loop(arrangement: Arrangement, run: Run, compiler: Compiler, lanes: bool = False) -> CompiledLoop:
    """Return an arrangement in C, made now or before, for a run that has it.

    It is held against the interpreted loop at random instants when it is made, and where the run starts.

    Raises CompilationError where it cannot be made, or is not the same.
    """
    from phcontrol.compilation.compiled_loop import CompiledLoop

    structure = arrangement.structure
    alike = [known for known in _LOOPS if known.structure == structure and known.compiler == compiler]
    made = next((known for known in alike if _starts(known, arrangement, run, bool(known.checked - {False}))), None)
    if made is None:  # or where numbers decide a branch, and do so otherwise
        made = CompiledLoop(arrangement, run.steps * run.dt, compiler)
    if lanes not in made.checked:
        _check(made, arrangement, run.loop, lanes)
        made.checked.add(lanes)
    _LOOPS[:] = [made, *(known for known in _LOOPS if known is not made)][:_KEPT]
    return made


def _starts(made: CompiledLoop, arrangement: Arrangement, run: Run, lanes: bool) -> bool:
    """Return whether a loop has the branch that a run starts with. Raises CompilationError where it is wrong there."""
    from phcontrol.compilation.compiled_loop import NOT_COMPILED, numbers_of_arrangement

    block = made.block([numbers_of_arrangement(arrangement)], lanes)
    set_up(block, [run.loop], [signals_of(run.loop.disturbance, run.loop.n)])
    found = block.field(0.0, run.start[:, None])
    if block.status[0]:
        return bool(block.status[0] != NOT_COMPILED)
    rate, torque, force = (part[:, :1] for part in found)
    refuse_beyond(difference_at(run.loop, bool(run.sensors), 0.0, run.start, (rate, torque, force)))
    return True


def refuse_beyond(difference: float) -> None:
    """Raise CompilationError where a loop differs too much from the interpreted one."""
    if not difference <= TOLERANCE:
        raise CompilationError(
            f"the loop as compiled is refused: it differs from the interpreted one by {difference:.1e}"
        )


def _instants(arrangement: Arrangement) -> Iterator[tuple[float, Array]]:
    """Yield times and states at which a loop is looked at."""
    from phcontrol.compilation.compiled_loop import TRACED
    from phcontrol.compilation.instants import instants

    law, generator = arrangement.law, np.random.default_rng(0)
    at_rest = [body.initial_state() for body in arrangement.bodies]
    for instant, _ in chain(instants(law, TRACED, seed=1), instants(law, _CHECKED, seed=3)):
        pushed = [state + 1e-3 * generator.normal(size=state.size) for state in at_rest]
        yield instant.time, np.concatenate([instant.position, instant.velocity, instant.state, *pushed])


def _check(made: CompiledLoop, arrangement: Arrangement, loop: ClosedLoop, lanes: bool) -> None:
    """Raise CompilationError where a loop in C is not the interpreted one."""
    from phcontrol.compilation.compiled_loop import NOT_COMPILED, numbers_of_arrangement

    numbers, signals = numbers_of_arrangement(arrangement), signals_of(loop.disturbance, loop.n)
    block = made.block([numbers], lanes)
    block = made.block([numbers] * block.lanes, lanes)
    set_up(block, [loop] * block.lanes, [signals] * block.lanes)
    observed, worst, looked = arrangement.observer is not None, 0.0, 0
    for t, y in _instants(arrangement):
        for tried in (loop, _clipped(loop, observed, t, y)) if arrangement.limited else (loop,):
            block.limit[:] = np.inf if tried.torque_limit is None else tried.torque_limit[:, None]
            block.status[:] = 0
            found = block.field(t, y[:, None])
            if (block.status == NOT_COMPILED).any():
                continue
            looked += 1
            worst = max(worst, difference_at(tried, observed, t, y, found))
    refuse_beyond(worst if looked else np.nan)


def _clipped(loop: ClosedLoop, observed: bool, t: float, y: Array) -> ClosedLoop:
    """Return a loop under limits of which some are half of what its law orders at an instant."""
    torque = np.abs(loop.evaluate(t, y, _shown(loop, observed)).torque)
    limit = np.where(np.arange(loop.n) % 3 == 2, 2.0, 0.5) * torque + 1e-6
    return ClosedLoop(loop.plant, loop.controller, loop.disturbance, limit, loop.bodies)


def _shown(loop: ClosedLoop, observed: bool) -> Held:
    """Return what is held where a sensor shows nothing yet; nothing without one."""
    return Held(measured=Measured(np.zeros(loop.n)) if observed else None)


def difference_at(loop: ClosedLoop, observed: bool, t: float, y: Array, found: tuple[Array, Array, Array]) -> float:
    """Return by how much, relatively, what was found in all lanes at one instant differs from the interpreted loop."""
    expected = loop.evaluate(t, y, _shown(loop, observed))
    worst = 0.0
    for one, other in zip(found, (expected.rate, expected.torque, expected.external_force), strict=True):
        size = max(1e-3, float(np.abs(other).max()))
        worst = max(worst, float(np.abs(one - other[:, None]).max() / size))
    return worst


def set_up(block: Block, loops: Sequence[ClosedLoop], signals: Sequence[Signals], runs: Sequence[Run] = ()) -> None:
    """Give the runs of a block their torque limits and disturbances, and those that go on their sensors."""
    rows = [felt_by(run.sensors[0], run.loop.n, run.steps, run.dt) for run in runs if run.sensors]
    if any(row is not None for row in rows):
        block.set_felt([row for row in rows if row is not None])
    read = [joint_readings(run.joint_sensor, run.loop.n, run.steps, run.dt) for run in runs if run.joint_sensor]
    if read:
        block.set_joints(read)
    for lane, run in enumerate(runs):
        block.first[:, lane] = run.first_torque
    for lane, (loop, disturbance) in enumerate(zip(loops, signals, strict=True)):
        block.limit[:, lane] = np.inf if loop.torque_limit is None else loop.torque_limit
        block.steady[:, lane] = disturbance.steady
    block.set_signals([disturbance.table for disturbance in signals])


def advance(block: Block, plan: Plan, record: Record, sink: Callable[[int, int, Record], None], chunk: int) -> None:
    """Simulate a block chunk by chunk, from the first row of the record.

    ``sink(first, rows, record)`` is shown each: rows samples from sample first on.
    """
    for first in range(0, plan.steps + 1, chunk):
        last = min(first + chunk - 1, plan.steps)
        block.advance(plan, first, last, record)
        sink(first, last - first + 1, record)
        if last == plan.steps or (block.status != 0).all():
            return
        record.states[0] = record.states[last - first + 1]


def plan_of(run: Run) -> Plan:
    """Return how a run is simulated."""
    from phcontrol.compilation.compiled_loop import Plan

    period, due = run.control_period or 0.0, due_of(run.sensors, run.dt)
    return Plan(run.steps, run.dt, run.integrator, run.stride, period, due, run.late)


def run_compiled(found: Prepared, run: Run, plan: Plan, sink: Callable[[int, int, Record], None]) -> bool:
    """Simulate a run; False where it must be simulated interpreted after all, which is said.

    A run that diverges, or whose torque is not finite, is one of these: the interpreted run then says what is wrong.
    """
    from phcontrol.compilation.compiled_loop import DONE, NO_SOLUTION, NOT_COMPILED, Record

    chunk = min(5000, plan.steps + 1)
    block = found.loop.block([found.numbers], lanes=False)
    set_up(block, [run.loop], [found.signals], [run])
    record = Record.empty(found.loop, chunk, block.lanes, bool(run.sensors), run.joint_sensor is not None)
    record.states[0, :, 0] = run.start
    last = np.abs(run.start).max(initial=0.0)

    def shown(first: int, rows: int, record: Record) -> None:
        nonlocal last
        last = np.abs(record.states[max(0, int(block.reached[0]) - first)]).max()
        sink(first, rows, record)

    advance(block, plan, record, shown, chunk)
    status, reached = int(block.status[0]), int(block.reached[0])
    if status == NOT_COMPILED and last < DIVERGED:
        say_interpreted(f"at t = {reached * plan.dt:g} s it takes a branch that is not compiled", 5)
    if status == NO_SOLUTION:
        say_interpreted(f"at t = {reached * plan.dt:g} s the implicit step is not found by iteration", 5)
    return status == DONE
