"""What an identified friction is worth on a simulated Franka Research 3, over the robot's own protocol.

    pip install 'phcontrol[franka]' franky-sim && franky-sim -s mujoco   # prints the simulated robot's address
    python benchmarks/franka_friction.py 127.0.0.1 --urdf fr3.urdf

A tracking law leads the arm along a motion in which friction shows, friction is identified from what was read and sent,
and then each law of examples/franka.py runs twice, by a model without friction and by one with it. The simulated robot
has 1.1 N·m of dry friction and 0.3 N·m·s/rad in each joint or so: see its fr3.xml.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from phcontrol import (
    ControlLoop,
    FrankaArm,
    Limits,
    MechanicalSystem,
    MinimumJerk,
    Motion,
    TorqueFilter,
    TrajectoryTracking,
    drive,
    exciting_trajectory,
    identify,
    load_robot,
    make_controller,
)

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from franka import LAWS, PERIOD, ROTORS, make_law

STIFFNESS = [600, 600, 600, 600, 250, 150, 50]  # [N·m/rad]
DAMPING = [50, 50, 50, 50, 30, 25, 15]  # [N·m·s/rad]


def run(address, system, make, seconds):
    """Drive a law and return times, positions, velocities, torques, and how the loop went."""
    limits = Limits.franka(system, velocity_margin=0.3)
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    with FrankaArm(address, system, recover=True) as arm:
        law, way = make(arm.position)
        filter_ = TorqueFilter(system, period=PERIOD, limits=limits)
        loop = ControlLoop(system, law, PERIOD, torque_filter=filter_, stale_after=0.02)
        drive(loop, arm, seconds, each_step=lambda t, now, u: rows.append((now.position, now.velocity, u.copy())))
        mode = loop.mode.name.lower()
        loop.stop("the end")
        drive(loop, arm, 0.5)
    position, velocity, torque = map(np.array, zip(*rows, strict=True))
    time = PERIOD * np.arange(len(position))  # the robot's
    return law, way, time, position, velocity, torque, f"{mode}, {arm.counts['lost']} lost"


def home(address, system, posture):
    """Bring the arm to a posture by integral action."""

    def make(start):
        way = MinimumJerk.within_limits(system.robot, start, posture)
        return make_controller("integral_action", system, posture, reference=way), way

    run(address, system, make, 6.0)


def main() -> None:
    """Identify, and print the errors with and without."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("address")
    parser.add_argument("--urdf", required=True)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    fingers = ("fr3_finger_joint1", "fr3_finger_joint2")
    robot = load_robot(options.urdf, locked_joints=fingers, armature=ROTORS)
    bare = MechanicalSystem(robot, friction=None)
    with FrankaArm(options.address, bare, recover=True) as arm:
        start = arm.position
    limits = Limits.franka(bare, velocity_margin=0.5)
    motion = exciting_trajectory(bare, limits, 20.0, what=("coulomb", "viscous"), start=start, candidates=40, share=0.6)

    def along(at):
        return TrajectoryTracking(bare, trajectory=motion, stiffness=STIFFNESS, damping=DAMPING), motion

    _, _, time, position, velocity, torque, ended = run(options.address, bare, along, 20.0)
    carried = torque + np.array([bare.at(q).gravity for q in position])  # what is sent is u - g
    shown = Motion.of(time, position, velocity, carried, held=True)
    found = identify(shown, ("coulomb", "viscous"), model=replace(robot, friction=None))
    print(ended)
    print(found)
    systems = {"without": bare, "with": MechanicalSystem(found.robot)}
    for name in LAWS:
        for which, system in systems.items():
            home(options.address, bare, start)
            made = run(options.address, system, lambda at, s=system, n=name: make_law(n, s, at), options.seconds)
            law, way, time, position, _, torque, ended = made
            if way is None:
                goal = law.pose_at(0.0).translation
                hand = [
                    np.linalg.norm(bare.at(q).placement(bare.hand_frame).translation - goal) for q in position[-500:]
                ]
                error = f"hand {1e3 * max(hand):.2f} mm off its goal at the end"
            else:
                errors = position - np.array([way.at(t).position for t in time])
                rms = 1e3 * np.sqrt(np.mean(errors**2))
                error = (
                    f"error {1e3 * np.abs(errors).max():.1f} mrad at most, {rms:.2f} rms, "
                    f"{1e3 * np.abs(errors[-500:]).max():.2f} at the end"
                )
            rate = np.abs(np.diff(torque, axis=0)).max() / PERIOD
            print(f"{name}, {which} friction: {ended}; {error}; rate {rate:.0f} N·m/s", flush=True)


if __name__ == "__main__":
    main()
