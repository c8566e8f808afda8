"""Large steps under stiff gains on franka-sim, which aborts as the robot's reflexes do: with the filter and without.

    python -m venv servers && servers/bin/pip install franka-sim        # its NumPy is another
    python benchmarks/franka_stress.py --server servers/bin/python --mjcf fr3.xml --urdf fr3.urdf

Each run is of 1 s, over libfranka's protocol, with ``--enforce-comm-constraints --enforce-motion-limits``: a step of
0.6 rad in all joints under 400 and 2500 times M_ii, ``start_time`` 0 and 0.5. Both programs keep real time: on a busy
computer the simulator aborts for torques that come late. ``fr3.xml`` and ``fr3.urdf`` come with franky-sim.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product

import numpy as np

from phcontrol import (
    ArmError,
    ControlLoop,
    FrankaArm,
    Limits,
    MechanicalSystem,
    RealTime,
    TorqueFilter,
    drive,
    load_robot,
    make_controller,
)

PERIOD, STEP = 1e-3, 0.6  # [s], [rad]
ROTORS = 0.195  # reflected inertia of each joint's motor [kg m²], as in MuJoCo's model of the arm


@contextmanager
def server(python: str, mjcf: str) -> Iterator[None]:
    """A simulated robot that aborts as a real one does."""
    command = [python, "-m", "franka_sim.run_server", "--no-gripper", "--enforce-comm-constraints"]
    process = subprocess.Popen(
        [*command, "--enforce-motion-limits"],
        env=os.environ | {"FR3_MJCF": mjcf, "PYTHONPATH": ""},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait(10.0)


def enter(arm: FrankaArm, patience: float = 20.0) -> FrankaArm:
    """Connect as soon as the simulated robot answers."""
    end = time.monotonic() + patience
    while True:
        try:
            return arm.__enter__()
        except ArmError:
            if time.monotonic() > end:
                raise
            time.sleep(0.5)


def outcome(system: MechanicalSystem, seed: int, stiffness: float, start_time: float, filtered: bool) -> str:
    """Run once and return how it ended."""
    inside = Limits.franka(system)
    arm = enter(FrankaArm("127.0.0.1", system, recover=True))
    try:
        start = arm.position
        signs = np.random.default_rng(seed).choice([-1.0, 1.0], system.n)
        goal = np.clip(start + STEP * signs, inside.lower + 0.05, inside.upper - 0.05)
        inertia = system.at(start).mass_matrix.diagonal()
        limits = Limits.franka(system, velocity_margin=0.35)
        loop = ControlLoop(
            system,
            make_controller("energy_shaping", system, goal, stiffness=stiffness * inertia),
            PERIOD,
            torque_filter=TorqueFilter(system, period=PERIOD, limits=limits) if filtered else None,
            start_time=start_time,
            stale_after=0.02,
        )
        drive(loop, arm, 1.0 + start_time)
        mode = loop.mode.name.lower()
        loop.stop("the end")
        drive(loop, arm, 0.3)
        return f"finished, {mode}, {arm.counts['lost']} readings lost"
    except ArmError as error:
        return f"ABORTED: {error}"
    finally:
        arm.__exit__(None, None, None)


def main() -> None:
    """Print a line a run, and how many finished."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", required=True, help="the Python that has franka-sim")
    parser.add_argument("--mjcf", required=True, help="the simulated robot")
    parser.add_argument("--urdf", required=True, help="the law's model of it")
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    fingers = ("fr3_finger_joint1", "fr3_finger_joint2")
    system = MechanicalSystem(load_robot(options.urdf, locked_joints=fingers, armature=ROTORS), friction=None)
    finished = {True: 0, False: 0}
    cases = list(product(range(options.seeds), (400.0, 2500.0), (0.0, 0.5)))
    with RealTime(priority=80, lock_memory=True, freeze_gc=True) as asked:
        print(asked)
        for filtered in (False, True):
            for seed, stiffness, start_time in cases:
                with server(options.server, options.mjcf):
                    ended = outcome(system, seed, stiffness, start_time, filtered)
                finished[filtered] += ended.startswith("finished")
                print(
                    f"{'with' if filtered else 'without'} filter, {stiffness:.0f} M_ii, start_time {start_time}, "
                    f"seed {seed}: {ended}",
                    flush=True,
                )
    print(f"finished: {finished[True]} of {len(cases)} with the filter, {finished[False]} without")


if __name__ == "__main__":
    main()
