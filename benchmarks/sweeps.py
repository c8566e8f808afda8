"""What a sweep costs: per run, per task, per gigabyte, and how it scales; carried to 10⁹ runs on paper.

    python benchmarks/sweeps.py [--spec FILE] [--runs N] [--chunk N] [--repeats N] [--json FILE]

All on this machine, rows interleaved, medians. Rates are those of the steady state: from the first part of each worker
to the last but those, without what starting, tracing and compiling take, which is a row of its own. A row of one worker
is held to one core with all that belongs to it: client and scheduler would have a core of their own otherwise.
Processor time is that of all processes together (of Dask: client, scheduler and workers): it says what an engine adds
also on a machine that has other things to do, where times that passed say little.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import dask
import numpy as np
import psutil
from distributed import LocalCluster
from timing import on_cores

from phcontrol import DaskScheduler, LocalProcesses, Sweep
from phcontrol._version import __version__
from phcontrol.sweeps.chunk import Chunk, run_chunk
from phcontrol.sweeps.engine import Engine
from phcontrol.sweeps.sweep_folder import SweepFolder

EXAMPLE = Path(__file__).parents[1] / "examples" / "sweep.toml"
TASKS = 500  # that do nothing
MANY = 10**9
QUIET = {  # workers that look after themselves less often, as docs/from-a-laptop-to-a-cluster.md advises
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "2s",
    "distributed.worker.memory.monitor-interval": "2s",
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spec", type=Path, default=EXAMPLE)
    parser.add_argument("--runs", type=int, default=4096, help="of each row and repeat")
    parser.add_argument("--chunk", type=int, default=256, help="runs of a task")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", metavar="FILE", help="write the figures there too")
    options = parser.parse_args()
    read = Sweep.read(options.spec)
    given = read.given | {"sampling": read.given["sampling"] | {"runs": options.runs, "chunk": options.chunk}}
    sweep = Sweep(**given)
    chunks = [
        Chunk(sweep.given, sweep.hash, first, min(first + options.chunk, sweep.runs), True, __version__)
        for first in range(0, sweep.runs, options.chunk)
    ]
    began = time.perf_counter()
    columns = run_chunk(chunks[0])
    figures: dict[str, list[float]] = {"start, trace and compile [s]": [time.perf_counter() - began]}
    for _ in range(options.repeats):
        for count, name in ((1, "1 process"), (2, "2 processes")):
            with on_cores(count):
                _note(figures, name, _steady(LocalProcesses(count), run_chunk, chunks, options.chunk))
        for count, name, quiet in (
            (1, "1 Dask worker", True), (2, "2 Dask workers", True), (2, "2 Dask workers as Dask has them", False),
        ):  # fmt: skip
            with on_cores(count), _dask(count, quiet) as engine:
                list(engine.run(run_chunk, chunks[:count]))  # compiles
                _note(figures, name, _steady(engine, run_chunk, chunks, options.chunk))
                if count == 1:
                    rate, used = _steady(engine, abs, list(range(TASKS)), 1)
                    figures.setdefault("task, Dask [s]", []).append(1.0 / rate)
                    figures.setdefault("task, Dask, processor time [s]", []).append(used)
        rate, used = _steady(LocalProcesses(1), abs, list(range(TASKS)), 1)
        figures.setdefault("task, process [s]", []).append(1.0 / rate)
        figures.setdefault("task, process, processor time [s]", []).append(used)
        figures.setdefault("in this process, processor time [s/run]", []).append(_processor_time(chunks))
    found = {name: statistics.median(values) for name, values in figures.items()}
    found["bytes per run"] = _bytes(sweep, columns)
    # ratios of neighbours in time: the machine's speed changes
    for name, over, under, factor in (
        ("scaling, processes", "2 processes [runs/s]", "1 process [runs/s]", 0.5),
        ("scaling, Dask", "2 Dask workers [runs/s]", "1 Dask worker [runs/s]", 0.5),
        ("Dask over processes, runs/s", "2 Dask workers [runs/s]", "2 processes [runs/s]", 1.0),
        ("Dask as it comes over processes, runs/s", "2 Dask workers as Dask has them [runs/s]",
         "2 processes [runs/s]", 1.0),
        ("Dask over processes, processor time", "1 Dask worker, processor time [s/run]",
         "1 process, processor time [s/run]", 1.0),
        ("2 processes over 1, processor time", "2 processes, processor time [s/run]",
         "1 process, processor time [s/run]", 1.0),
    ):  # fmt: skip
        found[name] = statistics.median(factor * a / b for a, b in zip(figures[over], figures[under], strict=True))
    print(f"{sweep!r}, {read.nominal.run['duration']:g} s each, parts of {options.chunk}; {os.cpu_count()} processors")
    for name, value in found.items():
        print(f"{name:<58}{value:>12.4g}")
    spent, size = found["1 process, processor time [s/run]"], found["bytes per run"]
    given_out = found["task, Dask [s]"]
    print(
        f"10⁹ runs: {MANY * spent / 3600.0:.3g} core hours, {MANY * size / 1e9:.3g} GB, {MANY / options.chunk:.2g} "
        f"tasks of {options.chunk} runs; a task takes Dask {1e3 * given_out:.2g} ms, so that one scheduler keeps at "
        f"most {options.chunk * spent / given_out:.0f} cores busy"
    )
    if options.json:
        Path(options.json).write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def _note(figures: dict[str, list[float]], name: str, found: tuple[float, float]) -> None:
    figures.setdefault(f"{name} [runs/s]", []).append(found[0])
    figures.setdefault(f"{name}, processor time [s/run]", []).append(found[1])


@contextlib.contextmanager
def _dask(workers: int, quiet: bool) -> Iterator[DaskScheduler]:
    """Give a Dask cluster of this machine: scheduler in this process, workers of one thread in theirs."""
    with (
        dask.config.set(QUIET if quiet else {}),
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as cluster,
        DaskScheduler(cluster.scheduler_address) as engine,
    ):
        yield engine


def _processor_time(chunks: list[Chunk]) -> float:
    began = time.process_time()
    for chunk in chunks[: max(1, len(chunks) // 4)]:
        run_chunk(chunk)
    return (time.process_time() - began) / chunks[max(1, len(chunks) // 4) - 1].last


def _steady(engine: Engine, task: Callable[[object], object], items: list[object], runs: int) -> tuple[float, float]:
    """Return runs per second and processor time per run, while every worker is at work."""
    times, used = [], []
    for done in engine.run(task, items):
        assert done.error is None, done.error
        times.append(time.perf_counter())
        if len(times) in (engine.workers, len(items) - engine.workers):
            used.append(_of_all_processes())
    between = len(items) - 2 * engine.workers
    passed = times[len(items) - engine.workers - 1] - times[engine.workers - 1]
    return runs * between / passed, (used[1] - used[0]) / (runs * between)


def _of_all_processes() -> float:
    """Return the processor time of this process and of those that it started and that are there."""
    own = psutil.Process()
    spent = 0.0
    for process in (own, *own.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            spent += sum(process.cpu_times()[:2])
    return spent


def _bytes(sweep: Sweep, columns: dict[str, object]) -> float:
    with tempfile.TemporaryDirectory() as place:
        folder = SweepFolder(Path(place) / "sweep", sweep.hash, sweep.record, sweep.columns)
        many = {name: list(column) * 4 for name, column in columns.items()}
        folder.write(0, {name: np.array(column) for name, column in many.items()})
        (part,) = (Path(place) / "sweep" / "parts").iterdir()
        return part.stat().st_size / len(many["run"])


if __name__ == "__main__":
    main()
