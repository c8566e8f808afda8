"""Time of one control step compiled to C, beside the interpreted one and a hand-written law, on seven joints.

    python benchmarks/compiled_step.py [--rounds N] [--law NAME ...] [--json FILE]

All are interleaved in one run; the ratios to the hand-written Slotine-Li law on Pinocchio are what to look at. For each
law: interpreted, compiled through ``system.at`` and ``evaluate``, and compiled by the direct entry ``step``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from reference import slotine_li
from timing import interleaved

from phcontrol import Measured, MechanicalSystem, compile_law, load_robot, make_controller
from phcontrol.compilation.caller import CALLER
from phcontrol.controllers.registry import CONTROLLERS

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
FEATURES = np.array([0.003, -0.002, 0.0025])  # (μ, ν, l) [m]
REFERENCE = "Slotine-Li, by hand"
BUDGETS = {  # of the ratio to Slotine-Li, by the direct entry
    ("energy_shaping", "coriolis"): 0.2,
    ("reduction_servo", "coriolis"): 0.5,
    ("hamiltonian_servo", "coriolis"): 0.5,
    ("cartesian_impedance", "coriolis"): 0.5,
    ("cartesian_impedance_with_tank", "coriolis"): 0.5,
    ("cartesian_tracking", "coriolis"): 0.5,
    ("hamiltonian_servo", "canonical"): 1.5,
}
JOINT_SPACE, CANONICAL = 0.3, 0.8


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=100, help="rounds of 20 calls each")
    parser.add_argument("--law", nargs="*", choices=list(CONTROLLERS), default=list(CONTROLLERS))
    parser.add_argument("--json", metavar="FILE", help="write the ratios there too")
    options = parser.parse_args()
    system = MechanicalSystem(load_robot("panda", locked_joints=FINGERS))
    generator = np.random.default_rng(0)
    q, v = system.robot.random_position(generator), generator.normal(size=system.n)
    force = generator.normal(size=system.n)
    measured = Measured(external_force=force, total_force=force, features=FEATURES)
    by_hand = slotine_li(system.model, np.array(system.robot.home), np.eye(system.n) * 20.0, 2.0)
    candidates: dict[str, Callable[[], object]] = {REFERENCE: lambda: by_hand(q, v)}
    reports = {}
    for name in options.law:
        for form in CONTROLLERS[name].law.forms:
            law = make_controller(name, system, interconnection=form)
            compiled = compile_law(law, progress=True)
            state, label = np.full(law.state_size, 0.1), f"{name} {form}"
            reports[label] = compiled.report
            candidates |= steps(label, system, law, compiled, (q, v, state, measured))
    times = interleaved(candidates, options.rounds)
    unit = times[REFERENCE].median
    print(f"panda, fingers locked; calls of compiled laws in {CALLER}; {REFERENCE}: {unit:.1f} µs")
    print(f"{'':<46}{'interpreted':>12}{'evaluate':>10}{'step':>8}{'p99':>8}{'operations':>12}{'compiled in':>13}")
    rows = {}
    for label, report in reports.items():
        ratios = [times[f"{label}: {kind}"].median / unit for kind in ("interpreted", "evaluate", "step")]
        p99 = times[f"{label}: step"].p99 / unit
        name, _, form = label.partition(" ")
        duration = report.trace_time + report.compile_time
        budget = BUDGETS.get((name, form), JOINT_SPACE if form == "coriolis" else CANONICAL)
        rows[label] = dict(zip(("interpreted", "evaluate", "step"), ratios, strict=True)) | {"p99": p99}
        rows[label] |= {"operations": report.operations, "difference": report.difference}
        print(
            f"{label:<46}{ratios[0]:>12.2f}{ratios[1]:>10.3f}{ratios[2]:>8.3f}{p99:>8.2f}{report.operations:>12}"
            f"{duration:>11.1f} s   {budget} {'met' if ratios[2] <= budget else 'MISSED'}"
        )
    if options.json:
        Path(options.json).write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def steps(label: str, system: MechanicalSystem, law, compiled, at) -> dict[str, Callable[[], object]]:
    """Return one step of a law in the three ways."""
    q, v, state, measured = at
    return {
        f"{label}: interpreted": lambda: law.evaluate(1.0, system.at(q, v), state, measured),
        f"{label}: evaluate": lambda: compiled.evaluate(1.0, system.at(q, v), state, measured),
        f"{label}: step": lambda: compiled.step(1.0, q, v, state, measured),
    }


if __name__ == "__main__":
    main()
