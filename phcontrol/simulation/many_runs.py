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
from phcontrol.compilation.errors import CompilationError, CompilationWarning
from phcontrol.compilation.signals import Signals
from phcontrol.exceptions import PHControlError
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.compiled_run import (
    DIVERGED,
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
from phcontrol.simulation.recordings import Recording, Recordings
from phcontrol.simulation.run import Run
from phcontrol.simulation.simulation_error import SimulationError, SimulationInterrupted

if TYPE_CHECKING:
    from phcontrol.compilation.compiled_loop import Arrangement, Block, CompiledLoop
    from phcontrol.compilation.law_inputs import Bodies

MEASURES = ("log", "final_state")
"""What can be asked of a run by name."""
_ROWS = 64  # samples that are kept of a run whose end alone is asked for
_AHEAD = 2  # blocks of each thread: one that runs, and one prepared for it or waiting to be looked at

Measure = str | Callable[[Log], Any]


class _Numbered(NamedTuple):
    """A run in C: its place, its numbers and its disturbance."""

    number: int
    run: Run
    arrangement: Arrangement
    numbers: Array
    signals: Signals
    key: Any
    """What tells its numbers from those of others."""


class _Waiting(NamedTuple):
    """Runs that go on, and what they will give."""

    numbered: list[_Numbered]
    result: Future[tuple[Block, Recording]]


class _Group:
    """Runs that need one compilation: they differ in numbers."""

    def __init__(self, structure: list[Any]) -> None:
        self.structure = structure
        self.made: CompiledLoop | None = None
        """The loop in C, when there is one."""
        self.gathered: list[_Numbered] = []
        """Runs that wait until there are as many as lanes."""
        self.problem = ""
        """Why its runs are simulated interpreted."""


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
        self._recordings = Recordings()

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
        waiting: deque[_Waiting] = deque()
        with remembering(), ThreadPoolExecutor(self._workers, thread_name_prefix="simulate_many") as pool:
            try:
                for group, numbered, many in self._blocks(left, bar):
                    try:
                        if group.made is None:
                            group.made = compiled_loop(numbered[0].arrangement, numbered[0].run, compiler, many)
                        block = self._block(group.made, numbered, many)
                    except SimulationInterrupted:
                        raise
                    except Exception as error:
                        group.problem = _said(error)
                        left += self._not_compiled(group.problem, [one.number for one in numbered])
                        continue
                    waiting.append(_Waiting(numbered, pool.submit(self._simulated, *block)))
                    while len(waiting) >= _AHEAD * self._workers or (waiting and waiting[0].result.done()):
                        left += self._take(waiting.popleft(), bar)
                while waiting:
                    left += self._take(waiting.popleft(), bar)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        return sorted(left)

    def _blocks(self, left: list[int], bar: Any) -> Iterator[tuple[_Group, list[_Numbered], bool]]:
        """Yield runs that go on together, as many as there are lanes, and whether they share their loop with others.

        To ``left`` go those that cannot be compiled at all.
        """
        from phcontrol.compilation.lanes import LANES

        groups: list[_Group] = []
        varied = self._varied()
        for index in range(self._count):
            numbered = self._numbered(index, varied, left, bar)
            if numbered is None:
                continue
            structure = numbered.arrangement.structure
            group = next((one for one in groups if one.structure == structure), None)
            if group is None:
                groups.append(group := _Group(structure))
            if group.problem:
                left += self._not_compiled(group.problem, [index])
                continue
            group.gathered.append(numbered)
            if len(group.gathered) == LANES:
                whole, group.gathered = group.gathered, []
                yield group, whole, True
        for group in groups:
            if group.gathered and group.problem:
                left += self._not_compiled(group.problem, [one.number for one in group.gathered])
            elif group.gathered:
                yield group, group.gathered, group.made is not None or len(group.gathered) > 1

    def _varied(self) -> Bodies:
        """Return the bodies whose inertias are not the same in all runs."""
        from phcontrol.compilation.law_inputs import differing_bodies

        plants: dict[int, Any] = {}
        models: dict[int, Any] = {}
        for index in range(self._count):
            found = self._arguments(index)
            plants[id(found["system"])], law = found["system"], found["controller"]
            models[id(law.system)] = law.system
        return differing_bodies(list(plants.values())) | differing_bodies(list(models.values()))

    def _numbered(self, index: int, varied: Bodies, left: list[int], bar: Any) -> _Numbered | None:
        """Return a run for the compiler; None where it is refused, which is its outcome, or cannot be compiled."""
        from phcontrol.compilation.compiled_loop import EXPLICIT, numbers_of_arrangement

        try:
            run = Run(**self._arguments(index))
        except Exception as error:  # refused arguments, or what a user's law raises
            self._found[index] = Outcome(index, None, _said(error), False)
            bar.update()
            return None
        observer, more = observer_among(run)
        problem = obstacles(run.loop, {"sensors": True if more else None})
        try:
            if problem:
                raise CompilationError(problem)
            arrangement, signals = arranged(run.loop, observer, run.integrator not in EXPLICIT)
            arrangement = arrangement._replace(varied=varied)
            numbers = numbers_of_arrangement(arrangement)
        except Exception as error:  # it cannot be traced, or a user's law raises: interpreted it will tell
            left += self._not_compiled(_said(error), [index])
            return None
        return _Numbered(index, run, arrangement, numbers, signals, self._key(index))

    def _key(self, index: int) -> Any:
        """Return what tells runs of one arrangement from others; things are alive, so that their ids are theirs."""
        found = self._arguments(index)
        bodies, disturbance, sensors = found["bodies"], found["disturbance"], found["sensors"]
        things = (found["system"], found["controller"], *(bodies if isinstance(bodies, (list, tuple)) else [bodies]))
        function = id(disturbance) if callable(disturbance) else None
        # of force sensors all numbers are inputs, and held against nothing
        shown = tuple(type(one) if type(one) is ForceSensor else id(one) for one in sensors or ())
        return (*(id(thing) for thing in things), function, shown)

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
    ) -> tuple[Block, Recording]:
        """Simulate a block, on a thread of the pool; return it, and what it recorded.

        With lanes first too, unless the last states alone are asked for. All of it goes on in C, without the lock of
        the interpreter: a thread that asks for it has to wait for the one that prepares.
        """
        run, plan = numbered[0].run, plan_of(numbered[0].run)
        ends_alone = self._measure == "final_state"
        rows = min(_ROWS, plan.steps + 1) if ends_alone else plan.steps + 1
        observed, joints = bool(run.sensors), run.joint_sensor is not None
        recording = self._recordings.take(made, rows, block.lanes, observed, joints, not ends_alone)
        recording.record.states[0] = start
        block.advance(plan, 0, plan.steps, recording.record)
        if not ends_alone:
            recording.sort()
        return block, recording

    def _take(self, waiting: _Waiting, bar: Any) -> list[int]:
        """Look at a block that has come to its end; return those that must be simulated interpreted after all."""
        from phcontrol.compilation.compiled_loop import DONE, NO_SOLUTION, NOT_COMPILED

        numbered, left = waiting.numbered, list[int]()
        try:
            block, recording = waiting.result.result()
        except SimulationInterrupted:
            raise
        except Exception as problem:
            return self._not_compiled(_said(problem), [one.number for one in numbered])
        for lane, (index, run, *_) in enumerate(numbered):
            status, reached = int(block.status[lane]), int(block.reached[lane])
            last = block.ends[:, lane]
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
                log = self._log(run, [part[lane] for part in recording.by_lane], reached + 1)
                self._found[index] = Outcome(index, log, error, True) if error else self._measured(index, log, True)
            bar.update()
        self._recordings.give_back(recording)
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
