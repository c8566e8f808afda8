"""A law on an arm that is reached by UDP: what a program for a real robot looks like.

    python examples/hardware_loop.py [--seconds 3] [--loss 0.05] [--outage 0.05]

Another process plays the robot's control box at 1 kHz, and its network loses, delays, duplicates and reorders packets.
For your robot, write a class with ``read``, ``write``, ``gravity`` and ``pace`` in place of ``UdpArm``; all else stays.
"""

from __future__ import annotations

import argparse

import numpy as np

from phcontrol import (
    ControlLoop,
    Limits,
    MechanicalSystem,
    MinimumJerk,
    TorqueFilter,
    UdpArm,
    drive,
    load_robot,
    make_controller,
)

PERIOD = 1e-3  # [s]
GOAL = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]  # [rad]


def make_system() -> MechanicalSystem:
    """Return the plant; runs in the other process too."""
    return MechanicalSystem(load_robot("pera"))


def main() -> None:
    """Drive the arm to a posture and print how it went."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--loss", type=float, default=0.05, help="share of packets lost")
    parser.add_argument("--outage", type=float, default=0.05, help="length of an outage in the middle [s]")
    options = parser.parse_args()
    system = make_system()
    way = MinimumJerk.within_limits(system.robot, system.robot.home, GOAL)
    controller = make_controller("force_feedback", system, GOAL, reference=way)
    limits = Limits(system, torque_rate=1000.0, position_margin=0.01, velocity_margin=0.1)  # [N·m/s], [rad], 1
    loop = ControlLoop(
        system,
        controller,
        PERIOD,
        torque_filter=TorqueFilter(system, period=PERIOD, limits=limits),
        start_time=0.3,  # [s]
        stale_after=0.03,  # [s]; a desktop's scheduler may keep both processes waiting for some milliseconds
    )
    faults = {
        "loss": options.loss,
        "delay": 5e-4,
        "jitter": 5e-4,
        "duplicates": 0.02,
        "outages": [(0.5 * options.seconds, options.outage)],
    }
    modes = []
    with UdpArm(make_system, duration=options.seconds + 5.0, period=PERIOD, faults=faults) as arm:
        drive(loop, arm, options.seconds, each_step=lambda t, reading, torque: modes.append(loop.mode.name))
        reading = arm.read()
    visited = [mode for mode, before in zip(modes, ["", *modes], strict=False) if mode != before]
    print("modes:", " -> ".join(visited))
    if loop.reason:
        print("last stop:", loop.reason)
    if reading is not None:
        print("distance from the goal [rad]:", np.round(np.abs(reading.position - GOAL).max(), 4))
    print("packets:", arm.counts, "loop:", loop.counts)
    print("filter:", {status.name.lower(): number for status, number in loop.torque_filter.counts.items()})
    print("timing:", loop.timing)


if __name__ == "__main__":
    main()
