"""Every law on two arms, driven at its limits and into a wall, without and with the torque filter.

    python examples/limits.py [--duration SECONDS] [--law NAME] [--arm NAME] [--torque-rate N·m/s]

Prints, for each run, by how much position, velocity and torque limits were exceeded, by how much velocity limits were
where the filter did not report it, by how much the storage function H_d grew beyond what the environment supplied, how
much of that the filter reported (the limits forbid what would be needed), and how much it did not.

Cartesian laws hit the stiff wall with all joints at their limits. It throws a Panda's third joint by more than the
motors can hold: 1.1 rad/s beyond the limit, reported; with ``--velocity-margin 0.3`` none (docs/api/safety.md).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from phcontrol import (
    FilterStatus,
    JointContact,
    Limits,
    Log,
    MechanicalSystem,
    RigidBody,
    TorqueFilter,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.controllers.registry import CONTROLLERS

PERIOD = 1e-3  # [s]
POSES = [name for name, entry in CONTROLLERS.items() if entry.law.run == "cartesian_impedance"]  # go to a pose
LAWS = [name for name, entry in CONTROLLERS.items() if entry.law.run == "position"] + POSES
ARMS = {"pera": (), "panda": ("panda_finger_joint1", "panda_finger_joint2")}  # and what is locked
MARGIN = 0.01  # how far inside its position limits the filter keeps the arm [rad]


@dataclass(frozen=True)
class Violations:
    """What a run did to the limits; 0 is best."""

    position: float
    """Largest way beyond a position limit [rad]."""
    velocity: float
    """Largest speed beyond a velocity limit [rad/s]."""
    thrown: float
    """Likewise, where the filter did not report that no torque keeps it [rad/s]."""
    torque: float
    """Largest torque beyond an effort limit [N·m]."""
    growth: float
    """Largest growth of H_d beyond what was supplied, over its largest value."""
    reported: float
    """How much growth the filter reported: ∫ storage_excess dt, over the same value."""
    unreported: float
    """Largest growth beyond what was supplied and reported, over the same value."""
    fallbacks: int
    """How often the solver's answer was not used."""

    def __str__(self) -> str:
        return (
            f"{self.position:>10.4f}{self.velocity:>10.4f}{self.thrown:>10.4f}{self.torque:>10.2f}"
            f"{self.growth:>11.1e}{self.reported:>11.1e}{self.unreported:>11.1e}{self.fallbacks:>5}"
        )


def run(
    law: str,
    arm: str,
    wall: bool,
    filtered: bool,
    duration: float = 1.0,
    torque_rate: float | None = None,
    velocity_margin: float = 0.1,
) -> Log:
    """Drive an arm beyond its limits: to a goal outside them, with stiff gains; or fast into a wall."""
    system = MechanicalSystem(load_robot(arm, locked_joints=ARMS[arm]))
    robot = system.robot
    start = robot.lower + 0.5 * (robot.upper - robot.lower)
    goal = robot.upper + 0.1
    if wall:
        goal = robot.lower + 0.75 * (robot.upper - robot.lower)
    options = {"force": 0.5 * robot.effort_limit} if law == "force_control" else {}
    controller = make_controller(law, system, goal, **options)
    joint = int(np.argmax(goal - start))
    bodies = [
        RigidBody(JointContact(robot.joint_names[joint], start[joint] + 0.15, "above"), stiffness=3e3, damping=5.0)
    ]
    limits = Limits(system, torque_rate=torque_rate, position_margin=MARGIN, velocity_margin=velocity_margin)
    return simulate(
        system,
        controller,
        duration=duration,
        dt=PERIOD,
        q0=start,
        control_period=PERIOD,
        torque_limit=None,
        torque_filter=TorqueFilter(system, period=PERIOD, limits=limits) if filtered else None,
        bodies=bodies if wall else (),
    )


def violations(log: Log, arm: str) -> Violations:
    """Return what a run did to the limits of its arm."""
    robot = load_robot(arm, locked_joints=ARMS[arm])
    beyond = np.maximum(log.position - robot.upper, robot.lower - log.position).max()
    supplied = np.concatenate([[0.0], np.cumsum(0.5 * (log.supplied_power[1:] + log.supplied_power[:-1]) * PERIOD)])
    own, largest, activity = log.storage - supplied, np.abs(log.storage).max(), log.filter_activity
    reported = np.cumsum(activity["storage_excess"]) * PERIOD if activity else np.zeros(len(log))
    speeds = (np.abs(log.velocity) - robot.velocity_limit).max(axis=1)
    thrown = speeds[1:] - (activity["motion_excess"][:-1] if activity else 0.0)
    beyond_reported = own - np.concatenate([[0.0], reported[:-1]])
    return Violations(
        position=max(0.0, float(beyond)),
        velocity=max(0.0, float(speeds.max())),
        thrown=max(0.0, float(thrown.max())),
        torque=max(0.0, float((np.abs(log.torque) - robot.effort_limit).max())),
        growth=growth_of(own) / largest,
        reported=float(reported[-1]) / largest,
        unreported=growth_of(beyond_reported) / largest,
        fallbacks=int((activity["status"] == FilterStatus.FALLBACK).sum()) if activity else 0,
    )


def growth_of(energy: np.ndarray) -> float:
    """Return by how much an energy rose at most above what it had been before."""
    return float((energy - np.minimum.accumulate(energy)).max())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=1.0, help="[s]")
    parser.add_argument("--law", choices=LAWS)
    parser.add_argument("--arm", choices=list(ARMS))
    parser.add_argument("--torque-rate", type=float, help="for the filter [N·m/s]")
    parser.add_argument("--velocity-margin", type=float, default=0.1, help="by what part limits are lowered")
    options = parser.parse_args()
    names = ("position", "velocity", "thrown", "torque"), ("H_d grew", "reported", "unreported")
    print(
        f"{'':<52}"
        + "".join(f"{name:>10}" for name in names[0])
        + "".join(f"{name:>11}" for name in names[1])
        + " fell"
    )
    for arm in [options.arm] if options.arm else ARMS:
        for law in [options.law] if options.law else LAWS:
            for wall in (False, True):
                for filtered in (False, True):
                    label = f"{arm} {law} {'wall' if wall else 'goal'} {'with' if filtered else 'without'}"
                    log = run(law, arm, wall, filtered, options.duration, options.torque_rate, options.velocity_margin)
                    print(f"{label:<52}{violations(log, arm)}", flush=True)


if __name__ == "__main__":
    main()
