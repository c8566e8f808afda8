"""Time of one control step: compiled to C, interpreted, written by hand, and by MuJoCo and Drake, on seven joints.

    python benchmarks/compiled_step.py [--rounds N] [--law NAME ...] [--json FILE]

All are interleaved in one run; the ratios to the hand-written Slotine-Li law on Pinocchio are what to look at. For each
law: interpreted, compiled through ``system.at`` and ``evaluate``, and compiled by the direct entry ``step``. MuJoCo and
Drake (extra ``peers``) compute the weight of energy shaping, whose springs and dampers NumPy adds.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import peer_drake
import peer_mujoco
from arms import panda
from peers import found_peers
from reference import energy_shaping, slotine_li
from timing import Timing, interleaved

from phcontrol import Measured, MechanicalSystem, compile_law, make_controller
from phcontrol.compilation.caller import CALLER
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.exceptions import PHControlError

FEATURES = np.array([0.003, -0.002, 0.0025])  # (μ, ν, l) [m]
REFERENCE = "Slotine-Li, by hand on Pinocchio"
KINDS = ("interpreted", "evaluate", "step")
BUDGETS = {  # of the ratio to Slotine-Li, by the direct entry
    ("energy_shaping", "coriolis"): 0.2,
    ("reduction_servo", "coriolis"): 0.5,
    ("hamiltonian_servo", "coriolis"): 0.5,
    ("cartesian_impedance", "coriolis"): 0.5,
    ("cartesian_impedance_with_tank", "coriolis"): 0.5,
    ("cartesian_tracking", "coriolis"): 0.5,
    ("hamiltonian_servo", "canonical"): 1.5,
}
JOINT_SPACE, CANONICAL, CARTESIAN = 0.3, 0.8, 0.5


def budget_of(name: str, form: str) -> float:
    """Return what the ratio of a law to Slotine-Li should not exceed, by the direct entry."""
    if form != "coriolis":
        return BUDGETS.get((name, form), CANONICAL)
    return BUDGETS.get((name, form), CARTESIAN if name.startswith("cartesian") else JOINT_SPACE)


def measured_steps(laws: Iterable[str], rounds: int) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Return a row for each law and form, and for each step by others; and lines that say what was left out."""
    system = panda()
    generator = np.random.default_rng(0)
    q, v = system.robot.random_position(generator), generator.normal(size=system.n)
    candidates, left_out = by_others(system, q, v), []
    force = generator.normal(size=system.n)
    seen = Measured(external_force=force, total_force=force, features=FEATURES)
    reports = {}
    for name in laws:
        for form in CONTROLLERS[name].law.forms:
            label = f"{name} {form}"
            try:
                law = make_controller(name, system, interconnection=form)
                compiled = compile_law(law, progress=True)
            except PHControlError as error:
                left_out.append(f"{label}: {error}")
                continue
            state = np.full(law.state_size, 0.1)
            reports[label] = compiled.report
            candidates |= steps(label, system, law, compiled, (q, v, state, seen))
    times = interleaved(candidates, rounds)
    unit = times[REFERENCE].median
    rows = {name: described(times[name], unit) for name in candidates if ": " not in name}
    for label, report in reports.items():
        name, _, form = label.partition(" ")
        row: dict[str, Any] = {"budget": budget_of(name, form)}
        for kind in KINDS:
            row |= {f"{kind} {key}": value for key, value in described(times[f"{label}: {kind}"], unit).items()}
        row |= {"operations": report.operations, "difference": report.difference, "ways": report.ways}
        row |= {"trace time": report.trace_time, "compile time": report.compile_time}
        rows[label] = row
    return rows, left_out


def described(timing: Timing, unit: float) -> dict[str, float]:
    """Return median and 99th percentile [µs], and the median over the reference."""
    return {"µs": timing.median, "p99": timing.p99, "ratio": timing.median / unit}


def by_others(system: MechanicalSystem, q: np.ndarray, v: np.ndarray) -> dict[str, Callable[[], object]]:
    """Return steps written by hand, and by the peers that are installed."""
    goal, n = np.array(system.robot.home), system.n
    stiffness, damping = np.diag(np.full(n, 20.0)), np.diag(np.full(n, 5.0))
    full = slotine_li(system.model, goal, np.eye(n) * 20.0, 2.0)
    simple = energy_shaping(system.model, goal, stiffness, damping)
    steps = {REFERENCE: lambda: full(q, v), "energy shaping, by hand on Pinocchio": lambda: simple(q, v)}
    if "mujoco" in found_peers():
        mujoco = peer_mujoco.step_of(peer_mujoco.model_of(system, 1e-3, "RK4"), goal, stiffness, damping)
        steps["energy shaping, by hand on MuJoCo"] = lambda: mujoco(q, v)
    if "drake" in found_peers():
        drake = peer_drake.step_of(system, goal, stiffness, damping)
        steps["energy shaping, by hand on Drake"] = lambda: drake(q, v)
    return steps


def steps(label: str, system: MechanicalSystem, law, compiled, at) -> dict[str, Callable[[], object]]:
    """Return one step of a law in the three ways."""
    q, v, state, measured = at
    return {
        f"{label}: interpreted": lambda: law.evaluate(1.0, system.at(q, v), state, measured),
        f"{label}: evaluate": lambda: compiled.evaluate(1.0, system.at(q, v), state, measured),
        f"{label}: step": lambda: compiled.step(1.0, q, v, state, measured),
    }


def lines_of(rows: dict[str, dict[str, Any]]) -> list[str]:
    """Return the table."""
    lines = [
        f"{'over Slotine-Li':<46}{'interpreted':>12}{'evaluate':>10}{'step':>8}{'operations':>12}{'compiled in':>13}"
    ]
    for label, row in rows.items():
        if "budget" not in row:
            lines.append(f"{label:<46}{row['ratio']:>12.2f}   ({row['µs']:.1f} µs)")
            continue
        met = "met" if row["step ratio"] <= row["budget"] else "MISSED"
        duration = row["trace time"] + row["compile time"]
        lines.append(
            f"{label:<46}{row['interpreted ratio']:>12.2f}{row['evaluate ratio']:>10.3f}{row['step ratio']:>8.3f}"
            f"{row['operations']:>12}{duration:>11.1f} s   {row['budget']} {met}"
        )
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=100, help="rounds of 20 calls each")
    parser.add_argument("--law", nargs="*", choices=list(CONTROLLERS), default=list(CONTROLLERS))
    parser.add_argument("--json", metavar="FILE", help="write the rows there too")
    options = parser.parse_args()
    rows, left_out = measured_steps(options.law, options.rounds)
    print(f"panda, fingers locked; calls of compiled laws in {CALLER}")
    for line in [*lines_of(rows), *left_out]:
        print(line)
    if options.json:
        Path(options.json).write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
