"""A law on an arm in MuJoCo: another plant than the simulator's own, behind the driver of a real robot.

    python examples/mujoco_arm.py [--seconds 3] [--mjcf scene.xml] [--robot panda]

Without an MJCF file MuJoCo reads the robot's own URDF, and the motion is compared with phcontrol's simulation. With
one, the plant is whatever the file says: contacts, friction, other objects.
"""

from __future__ import annotations

import argparse

import numpy as np

from phcontrol import ControlLoop, MechanicalSystem, MujocoArm, drive, load_robot, make_controller, simulate

PERIOD = 1e-3  # [s]
FINGERS = {"panda": ("panda_finger_joint1", "panda_finger_joint2")}


def main() -> None:
    """Drive the arm to a posture and print how it went."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--robot", default="panda")
    parser.add_argument("--mjcf", help="an MJCF file with the robot's joints in it")
    options = parser.parse_args()
    system = MechanicalSystem(load_robot(options.robot, locked_joints=FINGERS.get(options.robot, ())), friction=None)
    start = system.robot.home
    goal = system.robot.near_home()
    law = make_controller("energy_shaping", system, goal)
    arm = MujocoArm(system, options.mjcf, period=PERIOD, position=start)
    loop = ControlLoop(system, law, PERIOD, start_time=0.0, clock=lambda: arm.time)
    positions = []
    drive(loop, arm, options.seconds, each_step=lambda t, reading, torque: positions.append(reading.position))
    print("mode:", loop.mode.name, loop.reason)
    print("distance from the goal [rad]:", np.round(np.abs(arm.read().position - goal).max(), 4))
    print("external force [N·m]:", np.round(arm.read().measured.external_force, 3))
    if options.mjcf is None:
        log = simulate(
            system,
            law,
            duration=options.seconds,
            dt=PERIOD,
            q0=start,
            control_period=PERIOD,
            torque_limit="robot",
        )
        print(f"{np.abs(np.array(positions) - log.position[:-1]).max():.1e} rad from the simulation at most")


if __name__ == "__main__":
    main()
