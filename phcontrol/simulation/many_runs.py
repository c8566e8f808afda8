"""The work of many runs: which can be compiled together, and what becomes of them."""

from __future__ import annotations

import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from tqdm import tqdm

from phcontrol._validation import Array
from phcontrol.compilation.compiler import Compiler
from phcontrol.compilation.errors import CompilationError, CompilationWarning
from phcontrol.compilation.signals import Signals
from phcontrol.exceptions import PHControlError
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.compiled_run import (
    DIVERGED,
    advance,
    arranged,
    compiled_loop,
    compiler_found,
    difference_at,
    observer_among,
    obstacles,
    plan_of,
    refuse_beyond,
    set_up,
)
from phcontrol.simulation.log import Log
from phcontrol.simulation.outcome import Outcome
from phcontrol.simulation.run import Run
from phcontrol.simulation.simulation_error import SimulationError, SimulationInterrupted

if TYPE_CHECKING:
    from phcontrol.compilation.compiled_loop import Arrangement, Block, CompiledLoop, Record

MEASURES = ("log", "final_state")
"""What can be asked of a run by name."""
_CHUNK = 512  # samples that are kept of a run whose end alone is asked for
_AHEAD = 1  # blocks beside one for each thread that are prepared or wait to be looked at

Measure = str | Callable[[Log], Any]


class _Numbered(NamedTuple):
    """A run in C: its place, its numbers and its disturbance."""

    number: int
    run: Run
    numbers: Array
    signals: Signals
    key: Any
    """What tells its numbers from those of others."""


class _Group(NamedTuple):
    """Runs of one arrangement that differ in numbers."""

    arrangement: Arrangement
    indices: list[int]


class ManyRuns:
    """Many runs.

    Args:
        arguments: of each run, those of ``Run``, by its place.
        count: how many there are.
        measure: what is asked of each.
        workers: threads.
    """

    def __init__(self, arguments: Callable[[int], dict[str, Any]], count: int, measure: Measure, workers: int) -> None:
        self._arguments, self._count, self._measure, self._workers = arguments, count, measure, workers
        self._found: dict[int, Outcome] = {}
        self._reasons: dict[str, int] = {}
        self._verified: set[Any] = set()
        self._runs: dict[int, Run] = {}

    def outcomes(self, in_c: bool, progress: bool | None) -> list[Outcome]:
        """Simulate all and return what became of them, in their order."""
        disable = None if progress is None else not progress
        with tqdm(total=self._count, unit="run", disable=disable, delay=0.5, leave=False) as bar:
            left = list(range(self._count))
            if in_c:
                left = self._compiled(bar)
            for reason, count in self._reasons.items():
                warnings.warn(
                    f"{count} of {self._count} runs are simulated interpreted: {reason}", CompilationWarning,
                    stacklevel=3,
                )  # fmt: skip
            for index in left:
                self._found[index] = self._interpreted(index)
                bar.update()
        return [self._found[index] for index in range(self._count)]

    # --- interpreted --------------------------------------------------------------------------------

    def _interpreted(self, index: int) -> Outcome:
        arguments = self._arguments(index)
        try:
            log = simulate(arguments.pop("system"), arguments.pop("controller"), **arguments, progress=False)
        except SimulationInterrupted:
            raise
        except SimulationError as error:
            return Outcome(index, error.log if self._measure == "log" else None, str(error), False)
        except Exception as error:  # refused, or of a user's law, disturbance or sensor: the other runs go on
            return Outcome(index, None, _said(error), False)
        return self._measured(index, log, compiled=False)

    def _measured(self, index: int, log: Log, compiled: bool) -> Outcome:
        """Return what is asked of a run, of its log."""
        if callable(self._measure):
            try:
                return Outcome(index, self._measure(log), "", compiled)
            except Exception as error:  # a user's function: the other runs go on
                return Outcome(index, None, f"the measure failed: {type(error).__name__}: {error}", compiled)
        if self._measure == "log":
            return Outcome(index, log, "", compiled)
        last = [log.position[-1], log.velocity[-1], log.controller_state[-1], log.body_state[-1]]
        return Outcome(index, np.concatenate(last), "", compiled)

    # --- compiled -----------------------------------------------------------------------------------

    def _not_compiled(self, reason: str, indices: Sequence[int]) -> list[int]:
        self._reasons[reason] = self._reasons.get(reason, 0) + len(indices)
        return list(indices)

    def _compiled(self, bar: Any) -> list[int]:
        """Simulate in C what can be; return the places of the others, with reasons noted."""
        try:
            compiler = compiler_found()
        except CompilationError as error:
            return self._not_compiled(str(error), range(self._count))
        from phcontrol.compilation.law_inputs import remembering

        left: list[int] = []
        with remembering():
            for group in self._groups(left, bar):
                try:
                    left += self._run_group(group, compiler, bar)
                except SimulationInterrupted:
                    raise
                except Exception as error:  # likewise; what has come to its end is kept
                    left += self._not_compiled(_said(error), [i for i in group.indices if i not in self._found])
        return sorted(left)

    def _run(self, index: int, bar: Any) -> Run | None:
        """Return a run, or None where its arguments are refused, which is its outcome."""
        if index in self._runs:
            return self._runs.pop(index)
        try:
            return Run(**self._arguments(index))
        except Exception as error:  # refused arguments, or what a user's law raises
            self._found[index] = Outcome(index, None, _said(error), False)
            bar.update()
            return None

    def _groups(self, left: list[int], bar: Any) -> list[_Group]:
        """Return runs that can be compiled together; to ``left`` go those that cannot be at all."""
        from phcontrol.compilation.compiled_loop import EXPLICIT
        from phcontrol.compilation.law_inputs import differing_bodies

        known: dict[Any, Arrangement] = {}
        members: dict[Any, list[int]] = {}
        for index in range(self._count):
            key = self._key(index)
            if key in known:
                members[key].append(index)
                continue
            run = self._run(index, bar)
            if run is None:
                continue
            observer, more = observer_among(run)
            problem = obstacles(run.loop, {"sensors": True if more else None})
            if problem:
                left += self._not_compiled(problem, [index])
                continue
            try:
                arrangement, _ = arranged(run.loop, observer, run.integrator not in EXPLICIT)
            except Exception as error:  # it cannot be traced, or a user's law raises: interpreted it will tell
                left += self._not_compiled(_said(error), [index])
                continue
            known[key], members[key] = arrangement, [index]
            self._runs[index] = run  # is needed once more
        varied = differing_bodies([one.plant for one in known.values()])
        varied |= differing_bodies([one.law.system for one in known.values()])
        groups: list[tuple[list[Any], _Group]] = []
        for key, arrangement in known.items():
            arrangement = arrangement._replace(varied=varied)
            structure = arrangement.structure
            group = next((found for other, found in groups if other == structure), None)
            if group is None:
                group = _Group(arrangement, [])
                groups.append((structure, group))
            group.indices.extend(members[key])
        return [group for _, group in groups]

    def _key(self, index: int) -> Any:
        """Return what tells runs of one arrangement from others; things are alive, so that their ids are theirs."""
        found = self._arguments(index)
        bodies, disturbance, sensors = found["bodies"], found["disturbance"], found["sensors"]
        things = (found["system"], found["controller"], *(bodies if isinstance(bodies, (list, tuple)) else [bodies]))
        function = id(disturbance) if callable(disturbance) else None
        # of force sensors all numbers are inputs, and held against nothing
        shown = tuple(type(one) if type(one) is ForceSensor else id(one) for one in sensors or ())
        return (*(id(thing) for thing in things), function, shown)

    def _run_group(self, group: _Group, compiler: Compiler, bar: Any) -> list[int]:
        """Simulate runs of one structure; return those that must be simulated interpreted after all."""
        left: list[int] = []
        waiting: deque[Future[tuple[list[_Numbered], Block, Any]]] = deque()
        group.indices.sort()
        many = len(group.indices) > 1
        made: CompiledLoop | None = None
        with ThreadPoolExecutor(self._workers, thread_name_prefix="simulate_many") as pool:
            try:
                for numbered in self._blocks(group, left, bar):
                    if made is None:
                        made = compiled_loop(group.arrangement, numbered[0].run, compiler, many)
                    block = self._block(made, numbered, many)
                    waiting.append(pool.submit(self._simulated, *block))
                    while len(waiting) > _AHEAD + self._workers or (waiting and waiting[0].done()):
                        left += self._take(waiting.popleft(), bar)
                while waiting:
                    left += self._take(waiting.popleft(), bar)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        return left

    def _blocks(self, group: _Group, left: list[int], bar: Any) -> Iterator[list[_Numbered]]:
        """Yield as many runs as there are lanes, and again."""
        from phcontrol.compilation.compiled_loop import EXPLICIT, numbers_of_arrangement
        from phcontrol.compilation.lanes import LANES

        size = LANES if len(group.indices) > 1 else 1
        gathered: list[_Numbered] = []
        for index in group.indices:
            run = self._run(index, bar)
            if run is None:
                continue
            observer, more = observer_among(run)
            if more:  # of the others' kind, but with numbers that do not fit
                left += self._not_compiled(obstacles(run.loop, {"sensors": True}), [index])
                continue
            try:
                arrangement, signals = arranged(run.loop, observer, run.integrator not in EXPLICIT)
            except Exception as error:  # it cannot be traced, or a user's law raises: interpreted it will tell
                left += self._not_compiled(_said(error), [index])
                continue
            numbers = numbers_of_arrangement(arrangement._replace(varied=group.arrangement.varied))
            gathered.append(_Numbered(index, run, numbers, signals, self._key(index)))
            if len(gathered) == size:
                yield gathered
                gathered = []
        if gathered:
            yield gathered

    def _block(
        self, made: CompiledLoop, numbered: list[_Numbered], many: bool
    ) -> tuple[CompiledLoop, list[_Numbered], Block, Array]:
        """Return runs in a block, and where they start: those of new numbers are held against the interpreted loop."""
        from phcontrol.compilation.lanes import LANES

        size = LANES if many else 1
        filled = [*numbered, *[numbered[-1]] * (size - len(numbered))]
        block = made.block([one.numbers for one in filled], many)
        runs = [one.run for one in filled]
        set_up(block, [run.loop for run in runs], [one.signals for one in filled], runs)
        start = np.stack([one.run.start for one in filled], axis=-1)
        self._verify(block, numbered, start)
        return made, numbered, block, start

    def _verify(self, block: Block, numbered: list[_Numbered], start: Array) -> None:
        """Raise CompilationError where a run is not the interpreted one at its start; each set of numbers once."""
        if all(one.key in self._verified for one in numbered):
            return
        found = block.field(0.0, start)
        for lane, one in enumerate(numbered):
            if one.key in self._verified or block.status[lane]:
                continue  # of another status the run will speak
            self._verified.add(one.key)
            rate, torque, force = (part[:, lane : lane + 1] for part in found)
            observed = bool(one.run.sensors)
            refuse_beyond(difference_at(one.run.loop, observed, 0.0, one.run.start, (rate, torque, force)))
        block.status[:] = 0

    def _simulated(
        self, made: CompiledLoop, numbered: list[_Numbered], block: Block, start: Array
    ) -> tuple[list[_Numbered], Block, Any]:
        """Simulate a block, on a thread of the pool; return the last states, and its record with lanes first.

        Without the record where the last states alone are asked for.
        """
        from phcontrol.compilation.compiled_loop import Record

        run = numbered[0].run
        rows = min(_CHUNK, run.steps + 1) if self._measure == "final_state" else run.steps + 1
        record = Record.empty(made, rows, block.lanes, bool(run.sensors), run.joint_sensor is not None)
        record.states[0] = start
        last = np.zeros(record.states.shape[1:])

        def sink(first: int, count: int, record: Record) -> None:
            for lane in range(block.lanes):
                row = int(block.reached[lane]) - first
                if 0 <= row < count:
                    last[:, lane] = record.states[row, :, lane]

        advance(block, plan_of(run), record, sink, rows)
        if self._measure == "final_state":
            return numbered, block, (last, [])
        return numbered, block, (last, [np.ascontiguousarray(np.moveaxis(part, -1, 0)) for part in record])

    def _take(self, done: Future[tuple[list[_Numbered], Block, Any]], bar: Any) -> list[int]:
        """Look at a block that has come to its end; return those that must be simulated interpreted after all."""
        from phcontrol.compilation.compiled_loop import DONE, NO_SOLUTION, NOT_COMPILED

        numbered, block, result = done.result()
        left: list[int] = []
        for lane, (index, run, *_) in enumerate(numbered):
            status, reached = int(block.status[lane]), int(block.reached[lane])
            last = result[0][:, lane]
            wild = not np.abs(last).max(initial=0.0) < DIVERGED
            if status == NO_SOLUTION:
                left += self._not_compiled("an implicit step is not found by iteration", [index])
                continue
            if status == NOT_COMPILED and not wild:
                left += self._not_compiled("it takes a branch that is not compiled", [index])
                continue
            error = ""
            if status != DONE:
                error = f"stopped at t = {reached * run.dt:g} s: the loop diverged. "
                error += f"Try a smaller dt ({run.dt:g} s) or lower gains"
            if self._measure == "final_state":
                self._found[index] = Outcome(index, None if error else last.copy(), error, True)
            elif error and self._measure != "log":
                self._found[index] = Outcome(index, None, error, True)
            else:
                log = self._log(run, [part[lane] for part in result[1]], reached + 1)
                self._found[index] = Outcome(index, log, error, True) if error else self._measured(index, log, True)
            bar.update()
        return left

    @staticmethod
    def _log(run: Run, parts: list[Array], samples: int) -> Log:
        log = run.log()
        log.fill(0, run.dt, *(part[:samples] for part in parts))
        log.end(samples)
        return log if samples == run.steps + 1 else log.truncated()


def _said(error: Exception) -> str:
    """Return an error in words, a foreign one with the function that raised it: no traceback goes with an outcome."""
    if isinstance(error, PHControlError):
        return str(error)
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} in {last.name}, line {last.lineno} of {Path(last.filename).name}: {error}"
