"""Time of the torque filter on seven joints, warm, along closed loops that run into their limits.

    python benchmarks/torque_filter.py [--repeats N]

An arm is driven to a goal outside its limits, with and without a limit of the torque rate; then the states of that
run are gone through again, and each call is timed: the filter (with the law's passive port), apart for each way in
which it found its torque, between a step of the law itself and a hand-written Slotine-Li law, which tells the
machine's mood.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections import defaultdict

import numpy as np
from reference import slotine_li

from phcontrol import Limits, MechanicalSystem, TorqueFilter, load_robot, make_controller, simulate

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
PERIOD, DURATION, BUDGET = 1e-3, 1.5, 60.0


def main() -> None:
    """Print one table for each arm."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    repeats = parser.parse_args().repeats
    for title, system in {
        "panda, fingers locked": MechanicalSystem(load_robot("panda", locked_joints=FINGERS)),
        "pera": MechanicalSystem(load_robot("pera")),
    }.items():
        for name, rate in {"no rate limit": None, "torque rate limited": 1000.0}.items():
            table(f"{title}, {name}", system, rate, repeats)


def table(title: str, system: MechanicalSystem, torque_rate: float | None, repeats: int) -> None:
    """Time the filter on one arm and print the table."""
    robot, n = system.robot, system.n
    filter_ = TorqueFilter(system, period=PERIOD, limits=Limits(system, torque_rate=torque_rate))
    controller = make_controller("energy_shaping", system, robot.upper + 0.1)
    start = 0.5 * (robot.lower + robot.upper)
    log = simulate(system, controller, duration=DURATION, dt=PERIOD, q0=start, torque_filter=filter_)
    by_hand = slotine_li(system.model, np.array(robot.home), np.eye(n) * 20.0, 2.0)
    state = np.zeros(0)
    times: dict[str, list[int]] = defaultdict(list)
    clock = time.perf_counter_ns
    gc.disable()
    for _ in range(repeats):
        previous = None
        for k in range(len(log)):
            q, v = log.position[k], log.velocity[k]
            start_ns = clock()
            by_hand(q, v)
            times["Slotine-Li, by hand"].append(clock() - start_ns)
            start_ns = clock()
            x = system.at(q, v)
            command = controller.evaluate(0.0, x, state)
            times["energy_shaping"].append(clock() - start_ns)
            start_ns = clock()
            port = controller.passive_port(0.0, x, state)
            filtered = filter_.filter(x, command.torque, previous=previous, port=port)
            elapsed = clock() - start_ns
            times[f"filter: {filtered.status.name.lower()}"].append(elapsed)
            times["filter: all"].append(elapsed)
            previous = filtered.torque
    gc.enable()
    reference = float(np.median(times["Slotine-Li, by hand"]))
    print(f"\n{title}\n{'':<32}{'calls':>7}{'median':>11}{'p99':>11}{'/ S-L':>8}")
    for name, values in sorted(times.items()):
        if len(values) < 20:
            continue
        median, late = np.percentile(values, [50, 99])
        verdict = ""
        if name.startswith("filter"):
            verdict = f"  budget {BUDGET:g} µs {'met' if median <= 1e3 * BUDGET else 'MISSED'}"
        print(
            f"{name:<32}{len(values):>7}{median / 1e3:>8.1f} µs{late / 1e3:>8.1f} µs{median / reference:>8.1f}{verdict}"
        )


if __name__ == "__main__":
    main()
