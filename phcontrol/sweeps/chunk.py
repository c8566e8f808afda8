"""Some runs of a sweep, one after another: what a processor is given at a time."""

from __future__ import annotations

import contextlib
import gc
import math
import threading
import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol._version import __version__
from phcontrol.compilation.errors import CompilationWarning
from phcontrol.simulation.log import Log
from phcontrol.simulation.outcome import Outcome
from phcontrol.simulation.simulate_many import simulate_many
from phcontrol.sweeps.engine import EngineError
from phcontrol.sweeps.measure import evaluate, of_loops, text_of
from phcontrol.sweeps.scenarios import Scenarios

_MADE = threading.local()  # an arm serves one thread
_VARIED = ("system", "controller", "q0", "v0", "disturbance", "sensors", "joint_sensor", "bodies")


class Chunk(NamedTuple):
    """Runs first to last, without it, of a sweep."""

    given: dict[str, Any]
    """The arguments of the sweep."""
    hash: str
    first: int
    last: int
    compiled: bool
    """Whether to simulate compiled where that is possible."""
    version: str
    """Of phcontrol, where the sweep was called."""


class Row(NamedTuple):
    """What became of a run."""

    measures: dict[str, float]
    """Not a number where there is none."""
    error: str
    """Why it failed; "" for nothing."""
    compiled: bool


def run_chunk(chunk: Chunk) -> dict[str, Any]:
    """Do the runs of a chunk and return the columns of their results; a run that fails is a row with its error.

    Raises EngineError where the phcontrol that does it is another than the one that asks for it.
    """
    if chunk.version != __version__:
        raise VersionError(
            f"a worker has phcontrol {__version__}, and the sweep {chunk.version}: install the same on all"
        )
    scenarios = _scenarios(chunk)
    numbers = scenarios.space.rows(chunk.first, chunk.last)
    with _what_is_there_stays():
        rows = rows_of(scenarios, chunk.first, numbers, chunk.compiled)
    columns: dict[str, Any] = {"run": np.arange(chunk.first, chunk.last)}
    columns |= dict(zip(scenarios.space.names, numbers.T, strict=True))
    columns |= {name: np.array([row.measures.get(name, math.nan) for row in rows]) for name in scenarios.measures}
    columns["error"] = np.array([row.error for row in rows], dtype=object)
    columns["compiled"] = np.array([row.compiled for row in rows])
    return columns


class VersionError(EngineError):
    """A worker has another phcontrol."""


def _scenarios(chunk: Chunk) -> Scenarios:
    """Return the sweep of a chunk, made once in each thread."""
    if getattr(_MADE, "hash", None) != chunk.hash:
        _MADE.scenarios, _MADE.hash = Scenarios(**chunk.given), chunk.hash
    made: Scenarios = _MADE.scenarios
    return made


@contextlib.contextmanager
def _what_is_there_stays() -> Iterator[None]:
    """Keep the garbage collector from looking through all that was loaded, which takes 0.1 s in a Dask worker."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def rows_of(scenarios: Scenarios, first: int, numbers: Array, compiled: bool) -> list[Row]:
    """Do the runs from one on that have these numbers, those together for which ``simulate_many`` takes them."""
    found: dict[int, Row] = {}
    alike: dict[Any, dict[int, dict[str, Any]]] = {}
    runs = range(first, first + len(numbers))
    for run, row in zip(runs, numbers, strict=True):
        try:
            arguments = scenarios.loop_of(run, scenarios.named(row))
        except Exception as error:
            found[run] = Row({}, text_of(error), False)
            continue
        alike.setdefault((arguments["control_period"], arguments["torque_delay"]), {})[run] = arguments
    for together in alike.values():
        found |= dict(_simulated(scenarios, together, compiled))
    return [found[run] for run in runs]


def _simulated(scenarios: Scenarios, loops: dict[int, dict[str, Any]], compiled: bool) -> Iterator[tuple[int, Row]]:
    """Yield what became of runs that go on together; one after another where one of them breaks what all do."""
    common = {name: value for name, value in next(iter(loops.values())).items() if name not in _VARIED}
    varied: dict[str, Any] = {name: [loop[name] for loop in loops.values()] for name in _VARIED}
    for name in ("sensors", "joint_sensor"):
        if varied[name][0] is None:
            varied[name] = None

    def measured(log: Log) -> dict[str, float | str]:
        nominal = scenarios.nominal
        return evaluate(scenarios.measures, log, nominal.robot, nominal.goal)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CompilationWarning)  # which of them, is in the results
            warnings.filterwarnings("ignore", message="dt = .* is too long for the stiffest body")
            outcomes = simulate_many(**common, **varied, measure=measured, workers=1, progress=False, compiled=compiled)
    except Exception as error:
        if len(loops) == 1:
            yield next(iter(loops)), Row({}, text_of(error), False)
            return
        for run, loop in loops.items():
            yield from _simulated(scenarios, {run: loop}, compiled)
        return
    for (run, loop), outcome in zip(loops.items(), outcomes, strict=True):
        yield run, _row(scenarios, loop, outcome)


def _row(scenarios: Scenarios, loop: dict[str, Any], outcome: Outcome) -> Row:
    if outcome.error:
        return Row({}, outcome.error, outcome.compiled)
    found: dict[str, float | str] = outcome.value | of_loops(scenarios.measures, loop)
    problems = [f"{name}: {value}" for name, value in found.items() if isinstance(value, str)]
    numbers = {name: value for name, value in found.items() if not isinstance(value, str)}
    return Row(numbers, "; ".join(problems), outcome.compiled)
