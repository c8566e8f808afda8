"""Closed loops of arms with dry friction to goals outside their limits: the fastest speed over its limit.

    python -m tests.safety.friction_loops [--error -0.3] [--model 0.7] [--seeds 2]

The plant's friction is (1 + error) times that of the law's model; the filter's model has ``--model`` times the same.
"""

from __future__ import annotations

import argparse

import numpy as np

from phcontrol import InvalidArgumentError, Limits, Log, MechanicalSystem, TorqueFilter, make_controller, simulate
from tests.safety.true_motion import arm

ARMS = {name: {"name": name} for name in ("z1", "xarm7", "tiago", "talos_arm", "pera")} | {
    "panda, 0.5 N·m": {"name": "panda", "coulomb": 0.5},
    "panda, 2 N·m": {"name": "panda", "coulomb": 2.0},
    "panda, 2 to 3 N·m": {"name": "panda", "coulomb": 2.0, "static": 1.5},
}
RATES = (None, 3000.0, 1000.0, 300.0)


def loop(
    system: MechanicalSystem,
    limits: Limits,
    *,
    seed: int | None = None,
    error: float = 0.0,
    model: float = 1.0,
    duration: float = 1.0,
) -> Log:
    """Drive an arm to a goal outside its limits, from the middle and to the upper ones or, with a seed, at random."""
    robot, n = system.robot, system.n
    start, goal = 0.5 * (robot.lower + robot.upper), robot.upper + 0.1
    if seed is not None:
        rng = np.random.default_rng(seed)
        start = robot.lower + (robot.upper - robot.lower) * rng.uniform(0.2, 0.8, n)
        goal = np.where(rng.random(n) < 0.5, goal, robot.lower - 0.1)
    friction = system.friction
    seen = system if model == 1.0 else MechanicalSystem(robot, friction=friction.scaled(model))
    return simulate(
        system if not error else MechanicalSystem(robot, friction=friction.scaled(1.0 + error)),
        make_controller("energy_shaping", system, goal),
        duration=duration,
        dt=1e-4,
        q0=start,
        torque_limit=None,
        torque_filter=TorqueFilter(seen, period=1e-3, limits=limits),
        progress=False,
    )


def limits_of(system: MechanicalSystem, torque_rate: float | None, **options) -> Limits:
    """Return the robot's limits; some motors cannot hold their arm everywhere, which braking needs to be told."""
    if system.robot.name in ("tiago", "talos_arm"):
        options["braking_acceleration"] = 10.0
    return Limits(system, torque_rate=torque_rate, **options)


def main() -> None:
    """Print |q̇|/limit and the largest reported excess of each arm and torque rate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--error", type=float, default=0.0, help="of the friction that law and filter know")
    parser.add_argument("--model", type=float, default=1.0, help="part of the friction that the filter is given")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--duration", type=float, default=1.0, help="[s]")
    options = parser.parse_args()
    for title, what in ARMS.items():
        system = arm(**what)
        for rate in RATES:
            try:
                limits = limits_of(system, rate)
            except InvalidArgumentError as error:
                print(f"{title:<20}{rate} N·m/s: {error}")
                continue
            fastest = excess = 0.0
            for seed in range(options.seeds):
                log = loop(
                    system, limits, seed=seed, error=options.error, model=options.model, duration=options.duration
                )
                fastest = max(fastest, float((np.abs(log.velocity) / limits.velocity).max()))
                excess = max(excess, float(log.filter_activity["motion_excess"].max()))
            print(f"{title:<20}rate {rate!s:>7} N·m/s  |q̇|/limit {fastest:.4f}  excess {excess:.4f} rad/s", flush=True)


if __name__ == "__main__":
    main()
