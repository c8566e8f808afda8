"""Time of the torque filter on seven joints, warm, along smooth motions.

    python benchmarks/torque_filter.py [--steps N]

The arm swings on sines through its velocity limits, so that the filter passes torques, clips them and solves its
quadratic program in turn; each is timed apart, interleaved with one step of the law itself, with a
bare solve of DAQP where it is installed, and with a hand-written Slotine-Li law as the measure of the machine.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections import defaultdict

import numpy as np
from reference import slotine_li

from phcontrol import MechanicalSystem, load_robot, make_controller
from phcontrol.safety.limits import Limits
from phcontrol.safety.torque_filter import TorqueFilter

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
PERIOD, BUDGET = 1e-3, 60.0


def main() -> None:
    """Print one table for each arm."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20_000)
    steps = parser.parse_args().steps
    for title, system in {
        "panda, fingers locked": MechanicalSystem(load_robot("panda", locked_joints=FINGERS)),
        "pera": MechanicalSystem(load_robot("pera")),
    }.items():
        for name, rate in {"no rate limit": None, "torque rate limited": 1000.0}.items():
            table(f"{title}, {name}", system, rate, steps)


def table(title: str, system: MechanicalSystem, torque_rate: float | None, steps: int) -> None:
    """Time the filter on one arm and print the table."""
    limits = Limits(system, torque_rate=torque_rate)
    filter_ = TorqueFilter(system, period=PERIOD, limits=limits)
    controller = make_controller("energy_shaping", system, stiffness=60.0)
    robot, n = system.robot, system.n
    by_hand = slotine_li(system.model, np.array(robot.home), np.eye(n) * 20.0, 2.0)
    middle, reach = 0.5 * (robot.lower + robot.upper), 0.4 * (robot.upper - robot.lower)
    frequency = 1.15 * limits.velocity / reach
    phase = np.linspace(0.0, np.pi, n)
    previous, state = None, np.zeros(0)
    times: dict[str, list[int]] = defaultdict(list)
    clock = time.perf_counter_ns
    gc.disable()
    for k in range(steps):
        t = k * PERIOD
        q, v = middle + reach * np.sin(frequency * t + phase), reach * frequency * np.cos(frequency * t + phase)
        start = clock()
        by_hand(q, v)
        times["Slotine-Li, by hand"].append(clock() - start)
        start = clock()
        x = system.at(q, v)
        command = controller.evaluate(t, x, state)
        times["energy_shaping"].append(clock() - start)
        start = clock()
        port = controller.passive_port(t, x, state)
        filtered = filter_.filter(x, command.torque, previous=previous, port=port)
        times[f"filter: {filtered.status.name.lower()}"].append(clock() - start)
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
