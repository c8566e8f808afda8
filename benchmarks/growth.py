"""Time of a step and of a simulation as an arm grows: chains of 1 to 30 joints.

    python benchmarks/growth.py [--joints 1 2 3 7 14 30] [--longest 120]

For each length: Slotine-Li by hand, laws interpreted and compiled (operations, and what compiling took), and simulated
seconds per second of the compiled loop and of MuJoCo all in C. What would take longer to compile than ``LONGEST``,
by what the shorter chain took, is left out, and so is what the compiler does not come to the end of.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

import numpy as np
from arms import chain
from peers import DT, found_peers, measured_runs, ways_of
from reference import slotine_li
from timing import interleaved

from phcontrol import CompilationError, Measured, compile_law, make_controller

JOINTS = (1, 2, 3, 7, 14, 30)
LAWS = (
    ("energy_shaping", "coriolis"),
    ("force_feedback", "coriolis"),
    ("tracking", "coriolis"),
    ("tracking", "canonical"),
)
LONGEST = 120.0
"""[s]."""
_POWER = 3.0  # of the length, by which compiling grows at least
_LOOPS = 3.0  # how often as long as for a law alone compiling takes where its loop is compiled too, at most
_SIMULATED = 2.0  # [s]


def measured_growth(
    lengths: tuple[int, ...], rounds: int, repeats: int, seconds: float = math.inf, longest: float = LONGEST
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Return a row for each law and length, and lines that say what was left out.

    What would take more than ``longest`` to compile, or not be compiled within ``seconds`` from now on, is left out.
    """
    end = time.perf_counter() + seconds
    rows: dict[str, dict[str, Any]] = {}
    left_out: list[str] = []
    taken: dict[tuple[str, str], tuple[int, float]] = {}
    for n in lengths:
        system, generator = chain(n), np.random.default_rng(0)
        q, v = system.robot.random_position(generator), generator.normal(size=n)
        by_hand = slotine_li(system.model, np.zeros(n), np.eye(n) * 20.0, 2.0)
        candidates = {"by hand": lambda by_hand=by_hand, q=q, v=v: by_hand(q, v)}
        reports = {}
        for name, form in LAWS:
            law = make_controller(name, system, interconnection=form)
            state, seen = np.full(law.state_size, 0.1), Measured(external_force=np.zeros(n))
            candidates[f"{name} {form}"] = lambda law=law, system=system, q=q, v=v, state=state, seen=seen: (
                law.evaluate(1.0, system.at(q, v), state, seen)
            )
            shorter, duration = taken.get((name, form), (n, 0.0))
            expected = duration * (n / shorter) ** _POWER
            left = end - time.perf_counter()
            times_over = _LOOPS if (name, form) == ("force_feedback", "coriolis") else 1.0
            if expected > longest or times_over * expected > left or left < 0.0:
                left_out.append(f"{name} {form}, {n} joints, compiled: would take {expected:.0f} s or more to compile")
                continue
            try:
                compiled = compile_law(law, progress=True)
            except CompilationError as error:
                left_out.append(f"{name} {form}, {n} joints, compiled: {error}")
                continue
            report = reports[f"{name} {form}"] = compiled.report
            taken[name, form] = n, report.trace_time + report.compile_time
            candidates[f"{name} {form}, compiled"] = lambda c=compiled, q=q, v=v, state=state, seen=seen: c.step(
                1.0, q, v, state, seen
            )
        times = interleaved(candidates, rounds)
        unit = times["by hand"].median
        rows[f"Slotine-Li, by hand: {n}"] = {"joints": n, "µs": unit}
        for name, form in LAWS:
            label = f"{name} {form}"
            row: dict[str, Any] = {"joints": n, "µs": times[label].median, "ratio": times[label].median / unit}
            if label in reports:
                step = times[f"{label}, compiled"].median
                row |= {"compiled µs": step, "compiled ratio": step / unit, "operations": reports[label].operations}
                row |= {"compiled in [s]": reports[label].trace_time + reports[label].compile_time}
            rows[f"{label}: {n}"] = row
        if "force_feedback coriolis" not in reports:
            continue  # its loop is not compiled either
        steps = round(_SIMULATED / DT)
        ways = {
            name: way for name, way in ways_of(system, steps, peers=found_peers(), by_hand=False).items()
            if "continuous" in name
        }  # fmt: skip
        for name, run in measured_runs(ways, steps, repeats).items():
            rows[f"{name}: {n}"] = {"joints": n, "simulated s per s": run["simulated s per s"], "best": run["best"]}
    return rows, left_out


def lines_of(rows: dict[str, dict[str, Any]]) -> list[str]:
    """Return the table: a line for each law or loop, a column for each length."""
    lengths = list(dict.fromkeys(row["joints"] for row in rows.values()))
    labels = list(dict.fromkeys(name.rpartition(": ")[0] for name in rows))
    kinds = {"µs": "µs, interpreted or by hand", "compiled µs": "µs, compiled", "compiled in [s]": "s to compile",
             "simulated s per s": "simulated s per s"}  # fmt: skip
    lines = [f"{'joints':<86}" + "".join(f"{n:>9}" for n in lengths)]
    for label in labels:
        for kind, text in kinds.items():
            values = [rows.get(f"{label}: {n}", {}).get(kind) for n in lengths]
            if any(value is not None for value in values):
                cells = "".join("        -" if value is None else f"{value:>9.1f}" for value in values)
                lines.append(f"{label + ', ' + text:<86}{cells}")
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--joints", nargs="*", type=int, default=list(JOINTS))
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--longest", type=float, default=LONGEST, help="that one law may take to compile [s]")
    options = parser.parse_args()
    joints = tuple(options.joints)
    rows, left_out = measured_growth(joints, options.rounds, options.repeats, longest=options.longest)
    for line in [*lines_of(rows), *left_out]:
        print(line)


if __name__ == "__main__":
    main()
