"""What the default gains of every law make of a goal: given as a step, and led to by a minimum-jerk reference.

    python benchmarks/step_table.py [--arm NAME ...] [--law NAME ...] [--figure FILE.png]

Prints, for each law on each arm from its home to a posture near it: how far a joint went beyond the goal over its own
way (of joints that go at least a tenth as far as the one that goes farthest), and the largest speed over its limit.
With --figure it draws the elbow of the UR5 both ways instead.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np

from phcontrol import Log, MechanicalSystem, MinimumJerk, load_robot, make_controller, simulate
from phcontrol.controllers.registry import CONTROLLERS

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
ARMS = {
    "panda": {"locked_joints": FINGERS},
    "ur5": {},
    "z1": {"armature": 0.05},  # friction without rotors, as described, needs steps below 0.1 ms
    "xarm7": {"armature": 0.05},
}
LAWS = [
    "energy_shaping",
    "force_feedback",
    "force_feedback_measured",
    "integral_action",
    "total_force_rejection",
    "impedance_grasping",
    "classical_impedance",
    "classical_impedance_compensated",
]
DURATION, DT = 6.0, 1e-3  # [s]


def overshoot(log: Log, arm: MechanicalSystem, goal: np.ndarray) -> float:
    """Return how far a joint went beyond the goal, over its way."""
    way = arm.robot.difference(goal, log.position[0])
    beyond = np.maximum(0.0, (arm.robot.difference(log.position, goal) * np.sign(way)).max(axis=0))
    moved = np.abs(way) >= 0.1 * np.abs(way).max()
    return float((beyond[moved] / np.abs(way[moved])).max())


def row(name: str, law: str) -> str:
    """Run one law on one arm, both ways."""
    arm = MechanicalSystem(load_robot(name, **ARMS[name]))
    robot, goal = arm.robot, arm.robot.near_home()
    ways = {"step": {}}
    if "reference" in getattr(CONTROLLERS[law].law, "parameters", {}):
        ways["led"] = {"reference": MinimumJerk.within_limits(robot, robot.home, goal)}
    cells = []
    for options in ways.values():
        log = simulate(arm, make_controller(law, arm, goal, **options), duration=DURATION, dt=DT)
        speed = float((np.abs(log.velocity) / robot.velocity_limit).max())
        cells.append(f"{100.0 * overshoot(log, arm, goal):>12.1f} % {speed:>10.2f}")
    return f"{name:<8}{law:<34}" + "".join(cells)


def draw(path: str) -> None:
    """Draw an elbow that force feedback, integral action and energy shaping bring to a goal, given both ways."""
    import matplotlib.pyplot as plt

    arm = MechanicalSystem(load_robot("ur5"))
    robot, goal = arm.robot, arm.robot.near_home()
    elbow, led = robot.joint_index("elbow_joint"), MinimumJerk.within_limits(robot, robot.home, goal)
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.2), sharey=True, layout="constrained")
    for axis, title, options in zip(axes, ("a step", "a reference"), ({}, {"reference": led}), strict=True):
        for law in ("energy_shaping", "force_feedback", "integral_action"):
            log = simulate(arm, make_controller(law, arm, goal, **options), duration=DURATION, dt=DT)
            axis.plot(log.time, log.position[:, elbow], label=law.replace("_", " "))
        axis.axhline(goal[elbow], color="black", linewidth=0.8, linestyle="--")
        axis.set(title=f"the goal as {title}", xlabel="t [s]")
    axes[0].set_ylabel("elbow of the UR5 [rad]")
    axes[0].legend(frameon=False)
    figure.savefig(path, dpi=130)


def main() -> None:
    """Print the table, or draw the figure."""
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arm", nargs="*", choices=list(ARMS), default=list(ARMS))
    parser.add_argument("--law", nargs="*", choices=LAWS, default=LAWS)
    parser.add_argument("--figure", metavar="FILE.png", help="draw the elbow of the UR5 into this file instead")
    options = parser.parse_args()
    if options.figure:
        draw(options.figure)
        return
    print(f"{'':<42}{'step: overshoot':>14}{'speed':>10}{'led: overshoot':>15}{'speed':>10}")
    for arm in options.arm:
        for law in options.law:
            print(row(arm, law), flush=True)


if __name__ == "__main__":
    main()
