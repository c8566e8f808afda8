"""The control loop at 1 kHz on an arm in another process, over UDP: how punctual it is.

    python benchmarks/control_loop.py [--seconds 60] [--loss 0.0]

Prints the computing time of a step (p50, p99, p99.9, longest), the deadlines missed, and the time from one step to
the next; then the same for a bare loop that only waits and reads the clock, which is what the machine and its
scheduler do by themselves. Without a real-time kernel the longest times are the scheduler's.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from phcontrol import ControlLoop, Limits, MechanicalSystem, TorqueFilter, UdpArm, drive, load_robot, make_controller
from phcontrol.simulation.arm_driver import wait_until
from phcontrol.simulation.timing import TimingRecorder

PERIOD = 1e-3
GOAL = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]


def make_system() -> MechanicalSystem:
    """Return the plant."""
    return MechanicalSystem(load_robot("pera"))


def main() -> None:
    """Run both loops."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--loss", type=float, default=0.0)
    options = parser.parse_args()
    system = make_system()
    limits = Limits(system, torque_rate=2000.0, velocity_margin=0.1)
    loop = ControlLoop(
        system,
        make_controller("force_feedback", system, GOAL),
        PERIOD,
        torque_filter=TorqueFilter(system, period=PERIOD, limits=limits),
        stale_after=0.05,
    )
    with UdpArm(make_system, duration=options.seconds + 30.0, faults={"loss": options.loss}) as arm:
        drive(loop, arm, options.seconds)
        reading = arm.read()
    print(f"{loop.mode.name.lower()}; packets {arm.counts}; loop {loop.counts} {loop.reason}")
    print("filter", {status.name.lower(): number for status, number in loop.torque_filter.counts.items()})
    print("control loop:", loop.timing)
    if reading is not None:
        print(f"distance from the goal: {np.abs(reading.position - GOAL).max():.4f} rad")
    bare = TimingRecorder()
    start, steps = time.perf_counter(), round(min(10.0, options.seconds) / PERIOD)
    for k in range(steps):
        wait_until(start + k * PERIOD)
        now = time.perf_counter()
        bare.record(now, now)
    print("bare loop:   ", bare.timing(PERIOD))


if __name__ == "__main__":
    main()
