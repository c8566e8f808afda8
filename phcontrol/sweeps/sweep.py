"""A sweep: scenarios that are drawn, and what is measured of each."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

from phcontrol._files import open_regular
from phcontrol._version import __version__
from phcontrol.exceptions import DataFileError, InvalidArgumentError, UnknownNameError
from phcontrol.simulation.log import Log
from phcontrol.simulation.simulate_many import simulate_many
from phcontrol.simulation.simulation_error import SimulationError
from phcontrol.sweeps.chunk import Chunk, run_chunk
from phcontrol.sweeps.engine import Engine, EngineError
from phcontrol.sweeps.local_processes import LocalProcesses
from phcontrol.sweeps.progress import Progress
from phcontrol.sweeps.scenarios import TABLES, Scenarios
from phcontrol.sweeps.sweep_folder import SweepFolder
from phcontrol.sweeps.sweep_results import SweepResults

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LARGEST = 1 << 20
"""Bytes of a specification."""


class Sweep(Scenarios):
    """Scenarios × measures: a closed loop, what varies of it, how that is drawn, and what is measured of each run.

    Run k has the numbers and the noise that follow from ``seed`` and k, whoever does it. It is simulated compiled
    where it can be (:func:`simulate_many`), else interpreted; which, is in the results.

    Args:
        vary: how each quantity is drawn, by name (``VARIABLES``; ``gain.NAME`` and ``gain_factor.NAME`` of the law):
            a list of values, or what ``Distribution`` takes.
        measures: names (``MEASURES``), "my_module:function", functions of a log, or functions by name.
        sampling: ``method`` ("random", "latin_hypercube", "sobol", "grid", "list"), ``runs``, ``seed``, and ``chunk``,
            how many runs make a task and a part of the results.
        require: by measure, the number that it must not exceed for a run to count as good.
        parts: what describes the nominal loop: ``arm``, ``law``, ``run``, ``sensor`` (of forces), ``joint_sensor``,
            ``disturbance``, ``contact``.

    Raises:
        UnknownNameError: no quantity, measure, law, robot, joint or entry has that name; lists those that exist.
        InvalidArgumentError: what is given is out of its domain: a distribution of masses that goes below zero,
            a sensor that the law does not look at, …

    Example:
        >>> from phcontrol import Sweep
        >>> sweep = Sweep(
        ...     arm={"robot": "pera_shoulder"},
        ...     law={"name": "energy_shaping", "goal": [0.3, 0.5]},
        ...     run={"duration": 0.5},
        ...     vary={"mass_factor": {"uniform": [0.9, 1.1]}},
        ...     sampling={"method": "sobol", "runs": 4},
        ...     measures=["final_error"],
        ... )
        >>> sweep.scenario(2) == sweep.scenario(2)
        True
        >>> len(sweep.replay(2))
        501
    """

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Sweep:
        """Read a sweep from a TOML file: the arguments as tables, ``measures`` before them.

        Raises DataFileError where it cannot be read, and what the constructor raises.
        """
        with open_regular(path) as file:
            content = file.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise DataFileError(f"cannot read {path}: it is too large")
        try:
            given = tomllib.loads(content.decode())
        except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise DataFileError(f"cannot read {path}: {error}") from error
        for name in ("vary", "measures", "sampling"):
            if name not in given:
                form = "a list" if name == "measures" else f"a table, [{name}]"
                raise InvalidArgumentError(
                    name, f"must be given in {path}, as {form}; 'phcontrol init' writes a file to begin with"
                )
        for name in given:
            if name not in ("measures", *TABLES):
                raise UnknownNameError("part", name, ["measures", *TABLES])
            if name != "measures" and not isinstance(given[name], dict):
                raise InvalidArgumentError(name, f"must be a table, [{name}], but is {given[name]!r}")
        return cls(**given)

    def replay(self, run: int) -> Log:
        """Simulate a run again and return its log; of a run that fails, what there is of it."""
        arguments = self.loop(run)
        (outcome,) = simulate_many(**arguments, workers=1, progress=False, compiled=False)
        if outcome.value is None:
            raise InvalidArgumentError(f"run {run}", outcome.error)
        if outcome.error and not len(outcome.value):
            raise SimulationError(outcome.error, outcome.value)
        log: Log = outcome.value
        return log

    def run(
        self,
        directory: str | os.PathLike[str],
        *,
        engine: Engine | None = None,
        workers: int | None = None,
        progress: bool | None = None,
        compiled: bool = True,
    ) -> SweepResults:
        """Do every run that is not there yet, and return the results.

        Each part of the results is written at once and whole, when it is done: a sweep that was stopped, or killed,
        goes on from there when it is called again, on any engine. A run that fails is a row with its error.

        Args:
            directory: of the results: ``sweep.json`` and ``parts/*.parquet``.
            engine: what does the work; by default :class:`LocalProcesses`.
            workers: processes of that; by default one for each processor.
            progress: show a progress bar with the time left; by default only on a terminal.
            compiled: False simulates all interpreted.

        Raises:
            DataFileError: the folder is of another sweep or version, or cannot be written.
            EngineError: tasks whose processes died, again and again; all others are kept.
            InvalidArgumentError: pyarrow is not installed.
        """
        if engine is not None and workers is not None:
            raise InvalidArgumentError("workers", "are those of the engine, which is given")
        folder = SweepFolder(Path(directory), self.hash, self.record, self.columns)
        missing = [first for first in range(0, self.runs, self.chunk) if not folder.has(first, self._end(first))]
        at_work = LocalProcesses(workers) if engine is None else engine
        chunks = (Chunk(self.given, self.hash, first, self._end(first), compiled, __version__) for first in missing)
        total = sum(self._end(first) - first for first in missing)
        failed: dict[int, Exception] = {}
        with contextlib.ExitStack() as stack:
            bar = stack.enter_context(Progress(self.runs, self.runs - total, progress))
            for done in stack.enter_context(contextlib.closing(at_work.run(run_chunk, chunks))):
                if done.error is not None:
                    failed[done.item.first] = done.error
                    if not isinstance(done.error, EngineError):
                        raise done.error
                    continue
                bad = folder.write(done.item.first, done.value)
                bar.advance(done.item.last - done.item.first, bad)
        if failed:
            first, error = next(iter(failed.items()))
            raise EngineError(
                f"{len(failed)} of {len(missing)} parts are missing, of runs {first} to {self._end(first) - 1} first: "
                f"{error}. What is done is kept; the same call does what is missing"
            ) from error
        return SweepResults.read(directory)
