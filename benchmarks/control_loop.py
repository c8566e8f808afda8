"""The control loop at 1 kHz on an arm in another process, over UDP: how punctual it is, and what it does if not.

    python benchmarks/control_loop.py [--seconds 60] [--loss 0.0] [--busy 1] [--stale-after 0.05]

Prints the computing time of a step (p50, p99, p99.9, longest), the periods missed, and the time from one step to
the next; every change of mode with its reason; the memory after 5 s and at the end; then the timing of a bare loop that
only waits and reads the clock, which is what the machine and its scheduler do by themselves. Without a real-time
kernel the longest times are the scheduler's. ``--busy`` keeps so many further processes computing all the time: on two
cores, 1 leaves the loop and the arm's process one core and what they can get of the other.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from pathlib import Path

import numpy as np

from phcontrol import ControlLoop, Limits, MechanicalSystem, TorqueFilter, UdpArm, drive, load_robot, make_controller
from phcontrol.runtime.arm_driver import wait_until
from phcontrol.runtime.timing import TimingRecorder

PERIOD = 1e-3
GOAL = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]
SETTLED = 5.0  # from when on memory should not grow [s]


def make_system() -> MechanicalSystem:
    """Return the plant."""
    return MechanicalSystem(load_robot("pera"))


def keep_busy(parent: int) -> None:
    """Compute until the parent has ended."""
    while os.getppid() == parent:
        sum(range(100_000))


def own_memory() -> int:
    """Return how much memory of its own this process has [bytes], libraries' pages not counted; 0 if unknown."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    fields = dict(line.split(":", 1) for line in lines)
    return sum(1024 * int(fields[name].split()[0]) for name in ("RssAnon", "VmSwap") if name in fields)


def main() -> None:
    """Run both loops."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--busy", type=int, default=0, help="further processes that compute all the time")
    parser.add_argument("--stale-after", type=float, default=0.05, help="[s]")
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    others = [context.Process(target=keep_busy, args=(os.getpid(),), daemon=True) for _ in range(options.busy)]
    for process in others:
        process.start()
    system = make_system()
    limits = Limits(system, torque_rate=2000.0, velocity_margin=0.1)
    loop = ControlLoop(
        system,
        make_controller("force_feedback", system, GOAL),
        PERIOD,
        torque_filter=TorqueFilter(system, period=PERIOD, limits=limits),
        stale_after=options.stale_after,
    )
    changes = memory = active = 0
    mode = loop.mode

    def watch(t: float, reading: object, torque: np.ndarray) -> None:
        nonlocal changes, memory, mode, active
        if memory == 0 and t >= min(SETTLED, 0.2 * options.seconds):
            memory = own_memory()
        active += loop.mode.is_active
        if loop.mode != mode:
            changes, mode = changes + 1, loop.mode
            print(f"  {t:8.3f} s {mode.name.lower()} {loop.reason}", flush=True)

    with UdpArm(make_system, duration=options.seconds + 30.0, faults={"loss": options.loss}) as arm:
        drive(loop, arm, options.seconds, each_step=watch)
        grown = own_memory() - memory
        reading = arm.read()
    print(f"{loop.mode.name.lower()}; packets {arm.counts}; loop {loop.counts} {loop.reason}")
    print(f"{changes} changes of mode; the law acted in {active} of {round(options.seconds / PERIOD)} periods")
    print("filter", {status.name.lower(): number for status, number in loop.torque_filter.counts.items()})
    print("control loop:", loop.timing)
    print(f"memory: {memory / 2**20:.2f} MB after {SETTLED:g} s, {grown / 2**10:+.0f} kB until the end")
    if reading is not None:
        print(f"distance from the goal: {np.abs(reading.position - GOAL).max():.4f} rad")
    bare = TimingRecorder(PERIOD, PERIOD)
    start, steps = time.perf_counter(), round(min(10.0, options.seconds) / PERIOD)
    for k in range(steps):
        wait_until(start + k * PERIOD)
        now = time.perf_counter()
        bare.begin(now)
        bare.end(now)
    print("bare loop:   ", bare.timing)
    for process in others:
        process.terminate()


if __name__ == "__main__":
    main()
