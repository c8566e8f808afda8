"""Simulated seconds per second of ``simulate_many`` on seven joints, and how it scales over threads.

    python benchmarks/simulate_many.py [--runs N] [--duration S] [--repeats N] [--law NAME] [--json FILE]

Sweeps over initial states, stiffness, payload, friction and disturbances; sampled at 1 kHz and continuous, RK4 in steps
of 1 ms. All rows are interleaved in one run; medians. "per core" is simulated time over the processor time of the whole
process, "in all" over the time that passed. A row of one core is held to one: the thread that prepares the runs would
have a core of its own otherwise. Scaling is the rate in all on every core over that on one, divided by their number.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from timing import on_cores

from phcontrol import (
    CompilationWarning,
    MechanicalSystem,
    Sine,
    StribeckFriction,
    load_robot,
    make_controller,
    simulate,
    simulate_many,
)

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
RATE, SCALING = 500.0, 0.9  # what is to be reached
ARMS = 16  # payloads
INTERPRETED = 1.0  # simulated seconds of the interpreted loop


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=128)
    parser.add_argument("--duration", type=float, default=5.0, help="of each run [s]")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--law", default="force_feedback")
    parser.add_argument("--json", metavar="FILE", help="write the figures there too")
    options = parser.parse_args()
    warnings.simplefilter("error", CompilationWarning)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
    sweep = arguments(options.law, options.runs)
    total = options.runs * options.duration
    rows: dict[str, tuple[float, Callable[[], object]]] = {}
    for control, period in {"sampled at 1 kHz": 1e-3, "continuous": None}.items():
        common = {"duration": options.duration, "control_period": period}
        one = {name: value[0] for name, value in sweep.items()} | common

        def alone(one=one, **changed: object) -> None:
            own = one | changed
            simulate(own.pop("system"), own.pop("controller"), **own)

        rows[f"{control}: simulate, interpreted"] = (INTERPRETED, lambda run=alone: run(duration=INTERPRETED))
        rows[f"{control}: simulate, compiled"] = (options.duration, lambda run=alone: run(compiled=True))
        for workers in sorted({1, cores}):
            for name, measure in {"final states": "final_state", "peak torques": peak}.items():
                rows[f"{control}: {name}, {workers} core{'s' if workers > 1 else ''}"] = (
                    total,
                    lambda w=workers, m=measure, c=common: on_cores(w)(simulate_many)(
                        **sweep, **c, workers=w, measure=m
                    ),
                )
    figures = {name: [] for name in rows}
    for _, function in rows.values():
        function()  # compiles
    for _ in range(options.repeats):
        for name, (simulated, function) in rows.items():
            passed, used = time.perf_counter(), time.process_time()
            function()
            figures[name].append((simulated / (time.process_time() - used), simulated / (time.perf_counter() - passed)))
    found = {name: dict(zip(("per core", "in all"), np.median(rates, axis=0), strict=True))
             for name, rates in figures.items()}  # fmt: skip
    print(f"{options.law} on panda, fingers locked; {options.runs} runs of {options.duration:g} s; {cores} cores")
    print(f"{'simulated seconds per second':<44}{'per core':>10}{'in all':>10}")
    for name, rates in found.items():
        verdict = ""
        if name.endswith("final states, 1 core") and name.startswith("sampled"):
            verdict = f"   {RATE:g} per core {'met' if rates['per core'] >= RATE else 'MISSED'}"
        if cores > 1 and f", {cores} cores" in name:
            scaling = rates["in all"] / found[name.replace(f"{cores} cores", "1 core")]["in all"] / cores
            rates["scaling"] = scaling
            verdict = f"   scaling {scaling:.2f}, {SCALING} {'met' if scaling >= SCALING else 'MISSED'}"
        print(f"{name:<44}{rates['per core']:>10.0f}{rates['in all']:>10.0f}{verdict}")
    if options.json:
        Path(options.json).write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def peak(log) -> float:
    """Return the largest torque of a run [N·m]."""
    return float(np.abs(log.torque).max())


def arguments(name: str, runs: int) -> dict[str, list]:
    """Return what differs between runs."""
    generator, arms = np.random.default_rng(0), [loaded(0.1 * k) for k in range(ARMS)]
    law = make_controller(name, MechanicalSystem(load_robot("panda", locked_joints=FINGERS)))
    stiffness = np.diagonal(np.asarray(law.stiffness)) if hasattr(law, "stiffness") else None
    laws = [law if stiffness is None else law.changed(stiffness=factor * stiffness) for factor in
            np.linspace(0.5, 1.5, ARMS)]  # fmt: skip
    n, home = arms[0].n, np.array(arms[0].robot.home)
    return {
        "system": [arms[k % ARMS] for k in range(runs)],
        "controller": [laws[k // 3 % ARMS] for k in range(runs)],
        "q0": [home + 0.2 * generator.normal(size=n) for _ in range(runs)],
        "disturbance": [Sine(generator.normal(size=n), 0.5 + 0.1 * (k % 7)) for k in range(runs)],
    }


def loaded(payload: float) -> MechanicalSystem:
    """Return the arm with friction and a point mass in its hand [kg]."""
    friction = StribeckFriction(viscous=0.5 + 0.1 * payload)
    system = MechanicalSystem(load_robot("panda", locked_joints=FINGERS), friction=friction)
    hand = system.model.frames[system.frame_id(system.hand_frame)]
    mass = pin.Inertia(payload, hand.placement.translation, np.zeros((3, 3)))
    for model in (system.model, system.weightless_model):
        model.inertias[hand.parentJoint] = model.inertias[hand.parentJoint] + mass
    system.data = system.model.createData()
    return system


if __name__ == "__main__":
    main()
