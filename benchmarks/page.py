"""docs/benchmarks.md, made of a run of suite.py.

python benchmarks/page.py [benchmarks/results.json] [--out docs/benchmarks.md]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
_HEAD = """# Benchmarks

Made by `python benchmarks/page.py` of `benchmarks/results.json`, which `python benchmarks/suite.py`
writes (extra `phcontrol[peers]` for MuJoCo and Drake; what is not installed is left out). `python
benchmarks/compare.py OLD.json NEW.json` says what became faster or slower between two commits. All
candidates of a table take turns in one process; times of steps are of the clock, of simulations of
the processor.
"""


def page_of(run: dict[str, Any]) -> str:
    """Return the page."""
    machine = run["machine"]
    parts, left_out = run["parts"], run["left out"]
    facts = ", ".join(f"{name} {value}" for name, value in machine.items() if name not in ("processor", "cores"))
    blocks = [_HEAD]
    if run["quick"]:
        blocks.append("**This run was a quick one, which only shows that everything works: its times mean nothing.**\n")
    blocks.append(
        f"phcontrol {run['phcontrol']} at `{run['commit']}`, {run['date']}, {run['seconds']} s in all. "
        f"{machine['processor']}, {machine['cores']} cores; {facts}.\n"
    )
    if "step" in parts:
        blocks += ["## One control step\n", _STEP, _steps(parts["step"])]
    if "late" in parts:
        blocks += ["## The latest of a million\n", _LATE, _late(parts["late"])]
    if "simulation" in parts:
        blocks += ["## Simulation\n", _SIMULATION, _simulations(parts["simulation"])]
    if "growth" in parts:
        blocks += ["## Longer arms\n", _GROWTH, _growths(parts["growth"])]
    lines = [f"- {name}: {line}" for name, found in left_out.items() for line in found]
    if lines:
        blocks += ["## Left out\n", "\n".join(lines) + "\n"]
    return "\n".join(blocks)


_STEP = """The Panda with its fingers locked, seven joints. Ratios to a hand-written Slotine–Li law on Pinocchio:
interpreted; compiled, through `at` and `evaluate`; compiled, by the direct entry `step`, with the
budget of that. The largest relative difference from the interpreted law is of torques and state rates
at random states. Compiling is tracing and the C compiler.
"""
_LATE = """Compiled steps from Python, one after another, timed each by itself [µs]. Without a real-time kernel
the longest are the scheduler's.
"""
_SIMULATION = """Energy shaping (force feedback where it says so) on the Panda without friction, RK4 and others in
steps of 1 ms, every step logged. *By hand* is a loop of Python on `pin.aba` with NumPy; laws in
Python take gravity from Pinocchio, those in C are MuJoCo's own actuators with compensated weight, and
Drake's `JointStiffnessController`. Differences of positions are the largest of the whole run.
"""
_GROWTH = """Chains of n links about x and y. Steps are of the clock [µs], of a law and of Slotine–Li by hand;
loops are continuous [simulated s per s].
"""


def _table(head: list[str], rows: list[list[str]]) -> str:
    """Return a table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _steps(rows: dict[str, Any]) -> str:
    found = []
    for name, row in rows.items():
        if "budget" not in row:
            found.append([name, f"{row['ratio']:.2f} ({row['µs']:.1f} µs)", "", "", "", "", "", ""])
            continue
        met = "" if row["step ratio"] <= row["budget"] else " **missed**"
        found.append(
            [
                name,
                f"{row['interpreted ratio']:.2f}",
                f"{row['evaluate ratio']:.3f}",
                f"{row['step ratio']:.3f}",
                f"{row['budget']:g}{met}",
                str(row["operations"]),
                f"{row['difference']:.0e}",
                f"{row['trace time'] + row['compile time']:.1f} s",
            ]
        )
    head = ["step", "interpreted", "`evaluate`", "`step`", "budget", "operations", "difference", "compiled in"]
    return _table(head, found)


def _late(rows: dict[str, Any]) -> str:
    keys = ("µs", "p99", "p99.9", "longest")
    found = [[name, *(f"{row[key]:.2f}" for key in keys), str(row["steps"])] for name, row in rows.items()]
    return _table(["law", "median", "p99", "p99.9", "longest", "steps"], found)


def _simulations(rows: dict[str, Any]) -> str:
    def text(value: float | None) -> str:
        return "" if value is None else f"{value:.0e}"

    found = [
        [name, f"{row['simulated s per s']:.0f}", f"{row['best']:.0f}", str(row["order"]),
         text(row["from RK4 by hand [rad]"]), text(row["from ours of the same order [rad]"])]
        for name, row in rows.items()
    ]  # fmt: skip
    head = [
        "plant and integrator",
        "simulated s per s",
        "best",
        "order",
        "from RK4 by hand [rad]",
        "from our Euler [rad]",
    ]
    return _table(head, found)


def _growths(rows: dict[str, Any]) -> str:
    lengths = list(dict.fromkeys(row["joints"] for row in rows.values()))
    labels = list(dict.fromkeys(name.rpartition(": ")[0] for name in rows))
    kinds = {"µs": "step [µs]", "compiled µs": "step, compiled [µs]", "operations": "operations",
             "compiled in [s]": "compiled in [s]", "best": "simulated s per s"}  # fmt: skip
    found = []
    for label in labels:
        for kind, text in kinds.items():
            values = [rows.get(f"{label}: {n}", {}).get(kind) for n in lengths]
            if any(value is not None for value in values):
                cells = [
                    "" if value is None else f"{value:.0f}" if value >= 100 else f"{value:.3g}" for value in values
                ]
                found.append([f"{label}, {text}", *cells])
    return _table(["joints", *map(str, lengths)], found)


def _short(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, nargs="?", default=ROOT / "benchmarks" / "results.json")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "benchmarks.md")
    options = parser.parse_args()
    options.out.write_text(page_of(json.loads(options.run.read_text(encoding="utf-8"))), encoding="utf-8")
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
