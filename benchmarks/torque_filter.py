"""Time of the torque filter on seven joints, warm, along closed loops that run into their limits.

    python benchmarks/torque_filter.py [--repeats N]

An arm is driven to a goal outside its limits, with and without a limit of the torque rate, and against a stiff wall;
what the filter was asked in that run is asked again, and each call is timed, apart for each way in which it found its
torque, between calls of a hand-written Slotine-Li law, which reports the machine's mood. The law's passive port is not
included: it is timed on its own.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections import defaultdict
from typing import Any

import numpy as np
from reference import slotine_li

from phcontrol import (
    FilteredTorque,
    JointContact,
    Limits,
    MechanicalSystem,
    RigidBody,
    TorqueFilter,
    load_robot,
    make_controller,
    simulate,
)

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
PERIOD, DURATION, BUDGET, LATE = 1e-3, 1.5, 30.0, 80.0
CASES: dict[str, dict[str, Any]] = {
    "goal outside": {"law": "energy_shaping"},
    "goal outside, torque rate limited": {"law": "energy_shaping", "torque_rate": 1000.0},
    "wall, rest length": {"law": "impedance_grasping", "wall": True},
    "wall, force measured": {"law": "force_feedback_measured", "wall": True},
}


class RecordingFilter(TorqueFilter):
    """A torque filter that remembers what it was asked."""

    def filter(self, x: Any, torque: Any, **arguments: Any) -> FilteredTorque:
        """Filter, and remember."""
        self.__dict__.setdefault("asked", []).append((x.position.copy(), x.velocity.copy(), torque.copy(), arguments))
        return super().filter(x, torque, **arguments)


def main() -> None:
    """Print one table for each arm and case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    repeats = parser.parse_args().repeats
    for title, system in {
        "panda, fingers locked": MechanicalSystem(load_robot("panda", locked_joints=FINGERS)),
        "pera": MechanicalSystem(load_robot("pera")),
    }.items():
        for name, case in CASES.items():
            table(f"{title}, {name}", system, repeats, **case)


def table(
    title: str,
    system: MechanicalSystem,
    repeats: int,
    *,
    law: str,
    torque_rate: float | None = None,
    wall: bool = False,
) -> None:
    """Time the filter on one arm and print the table."""
    robot, n = system.robot, system.n
    filter_ = RecordingFilter(system, period=PERIOD, limits=Limits(system, torque_rate=torque_rate))
    start = 0.5 * (robot.lower + robot.upper)
    goal = robot.lower + 0.75 * (robot.upper - robot.lower) if wall else robot.upper + 0.1
    controller = make_controller(law, system, goal)
    joint = int(np.argmax(goal - start))
    contact = JointContact(robot.joint_names[joint], start[joint] + 0.15, "above")
    bodies = [RigidBody(contact, stiffness=3e3, damping=5.0)] if wall else ()
    simulate(system, controller, duration=DURATION, dt=PERIOD, q0=start, torque_filter=filter_, bodies=bodies)
    by_hand = slotine_li(system.model, np.array(robot.home), np.eye(n) * 20.0, 2.0)
    asked = filter_.__dict__["asked"]
    state = controller.random_state(np.random.default_rng(0))
    times: dict[str, list[int]] = defaultdict(list)
    clock = time.perf_counter_ns
    gc.disable()
    for _ in range(repeats):
        for position, velocity, desired, arguments in asked:
            start_ns = clock()
            by_hand(position, velocity)
            times["Slotine-Li, by hand"].append(clock() - start_ns)
            x = system.at(position, velocity)
            _ = x.mass_matrix, x.factor, x.coriolis_matrix, x.potential_gradient, x.friction_torque  # the law's work
            start_ns = clock()
            controller.passive_port(0.0, x, state)
            times["passive port"].append(clock() - start_ns)
            start_ns = clock()
            filtered = TorqueFilter.filter(filter_, x, desired, **arguments)
            elapsed = clock() - start_ns
            times[f"filter: {filtered.status.name.lower()}"].append(elapsed)
            times["filter: all"].append(elapsed)
    gc.enable()
    reference = float(np.median(times["Slotine-Li, by hand"]))
    print(f"\n{title}\n{'':<32}{'calls':>7}{'median':>11}{'p99':>11}{'/ S-L':>8}")
    for name, values in sorted(times.items()):
        if len(values) < 20:
            continue
        median, late = np.percentile(values, [50, 99])
        verdict = ""
        if name.startswith("filter"):
            met = median <= 1e3 * BUDGET and late <= 1e3 * LATE
            verdict = f"  budget {BUDGET:g} and {LATE:g} µs {'met' if met else 'MISSED'}"
        print(
            f"{name:<32}{len(values):>7}{median / 1e3:>8.1f} µs{late / 1e3:>8.1f} µs{median / reference:>8.1f}{verdict}"
        )


if __name__ == "__main__":
    main()
