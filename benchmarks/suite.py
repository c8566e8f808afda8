"""All benchmarks that are compared over commits, in one run: prints the tables and writes one JSON.

    python benchmarks/suite.py [--out benchmarks/results.json] [--part NAME ...] [--quick]

Compiles every law anew, into a cache of its own. On a quiet machine it takes less than ten minutes; --quick is a run
that only shows that everything works. ``compare.py`` compares two such files, ``page.py`` makes docs/benchmarks.md of
one.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import tempfile
import time
from collections.abc import Callable
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

import compiled_step
import growth
import numpy as np
import peers
from arms import panda

from phcontrol import Measured, __version__, compile_law, make_controller
from phcontrol.compilation.caller import CALLER
from phcontrol.compilation.compiler import find_compiler
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.mechanics.kernels import KERNELS

FORMAT = 1
PARTS = ["step", "late", "simulation", "growth"]
LATE = ("energy_shaping", "force_feedback", "tracking", "hamiltonian_servo")
ROOT = Path(__file__).parents[1]
PACKAGES = ("pin", "numpy", "casadi", "mujoco", "drake")


def machine() -> dict[str, Any]:
    """Return what the numbers were measured on."""
    processor = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        processor = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    compiler = find_compiler()
    return {
        "processor": processor,
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()}",
        "Python": platform.python_version(),
        "compiler": "none" if compiler is None else compiler.version,
        "kernels": KERNELS,
        "calls of compiled laws": CALLER,
        "load before": round(os.getloadavg()[0], 2),
    } | {name: _version(name) for name in PACKAGES}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def commit() -> str:
    """Return the commit that was measured, and whether files were changed beside."""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()


def late_steps(count: int) -> dict[str, dict[str, float]]:
    """Return how late compiled steps come in a row of many: median, p99, p99.9 and the longest [µs]."""
    system, rows = panda(), {}
    generator, n = np.random.default_rng(0), system.n
    q, v = system.robot.random_position(generator), generator.normal(size=n)
    seen = Measured(external_force=np.zeros(n), total_force=np.zeros(n), features=compiled_step.FEATURES)
    for name in LATE:
        law = compile_law(make_controller(name, system))
        step, state, clock, times = law.step, np.zeros(law.state_size), time.perf_counter_ns, np.empty(count)
        for k in range(count):
            start = clock()
            step(1.0, q, v, state, seen)
            times[k] = clock() - start
        low, p99, late = np.percentile(times, [50, 99, 99.9]) / 1e3
        rows[name] = {"µs": low, "p99": p99, "p99.9": late, "longest": times.max() / 1e3, "steps": count}
    return rows


def late_lines(rows: dict[str, dict[str, float]]) -> list[str]:
    """Return the table."""
    lines = [f"{'compiled steps in a row [µs]':<30}{'median':>9}{'p99':>9}{'p99.9':>9}{'longest':>10}{'steps':>10}"]
    return lines + [
        f"{name:<30}{row['µs']:>9.2f}{row['p99']:>9.2f}{row['p99.9']:>9.2f}{row['longest']:>10.1f}{row['steps']:>10}"
        for name, row in rows.items()
    ]


def parts(quick: bool, end: float) -> dict[str, Callable[[], tuple[dict[str, Any], list[str], list[str]]]]:
    """Return what can be measured: functions that return rows, the table, and what was left out.

    Args:
        quick: only show that everything runs.
        end: when all should be done, by ``time.perf_counter``.
    """

    def step() -> tuple[dict[str, Any], list[str], list[str]]:
        laws = ["energy_shaping", "force_feedback"] if quick else list(CONTROLLERS)
        rows, left_out = compiled_step.measured_steps(laws, 5 if quick else 60)
        return rows, compiled_step.lines_of(rows), left_out

    def late() -> tuple[dict[str, Any], list[str], list[str]]:
        rows = late_steps(10_000 if quick else 1_000_000)
        return rows, late_lines(rows), []

    def simulation() -> tuple[dict[str, Any], list[str], list[str]]:
        steps = 200 if quick else round(peers.DURATION / peers.DT)
        rows = peers.measured_runs(
            peers.ways_of(panda(friction=False), steps, peers=peers.found_peers()), steps, 1 if quick else 7
        )
        missing = [f"{name}: not installed" for name in peers.PEERS if name not in peers.found_peers()]
        return rows, peers.lines_of(rows), missing

    def grown() -> tuple[dict[str, Any], list[str], list[str]]:
        lengths, rounds, repeats = ((1, 2), 5, 1) if quick else (growth.JOINTS, 40, 5)
        rows, left_out = growth.measured_growth(lengths, rounds, repeats, end - time.perf_counter())
        return rows, growth.lines_of(rows), left_out

    return {"step": step, "late": late, "simulation": simulation, "growth": grown}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results.json", metavar="FILE.json")
    parser.add_argument("--part", nargs="*", choices=PARTS, default=PARTS)
    parser.add_argument("--quick", action="store_true", help="only show that everything runs")
    parser.add_argument("--minutes", type=float, default=9.0, help="after which no more arms are compiled")
    options = parser.parse_args()
    begun, found = time.perf_counter(), machine()
    result: dict[str, Any] = {
        "format": FORMAT,
        "phcontrol": __version__,
        "commit": commit(),
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d"),
        "quick": options.quick,
        "machine": found,
        "parts": {},
        "left out": {},
    }
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder, "cache")
        os.environ["PHCONTROL_CACHE"] = str(cache)
        for name, measure in parts(options.quick, begun + 60.0 * options.minutes).items():
            if name not in options.part:
                continue
            rows, table, left_out = measure()
            result["parts"][name], result["left out"][name] = rows, left_out
            found["load after"] = round(os.getloadavg()[0], 2)
            result["seconds"] = round(time.perf_counter() - begun)
            text = json.dumps(result, indent=1, ensure_ascii=False) + "\n"
            options.out.write_text(text, encoding="utf-8")  # after each part: a run may be ended
            print(f"\n{name}\n" + "\n".join([*table, *left_out]), flush=True)
    print(f"\nwrote {options.out} after {result['seconds']} s")


if __name__ == "__main__":
    main()
