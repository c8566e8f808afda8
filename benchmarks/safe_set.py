"""Starts on the border of safe sets: none may reach a limit, and how much larger a set none of the drawn leaves.

    python benchmarks/safe_set.py --starts 100000

For each arm and law it draws starts with H_d = c, simulates all of them (``simulate_many``), and counts those that pass
a position or velocity limit (of energy shaping, an effort limit too). Then c is made larger until one of ``--others``
starts passes one: the factor says how careful the set is, as far as it was looked for.
"""

from __future__ import annotations

import argparse
import math
import time
from functools import partial

import numpy as np

from phcontrol import Controller, Log, MechanicalSystem, SafeSet, load_robot, make_controller, safe_set, simulate_many
from phcontrol.mechanics.least_inertia import least_inertia

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
ARMS = {"panda": FINGERS, "pera": [], "ur5": []}
LAWS = {"energy_shaping": ("position", "velocity", "effort"), "force_feedback": ("position", "velocity")}
FACTORS = 1.25 ** np.arange(1, 40)
BATCH = 5000


def largest(log: Log, law: Controller) -> tuple[float, float, float]:
    """Return how much of each kind of limit a run used, of the joint that used most: 1 is the limit."""
    robot, away = law.system.robot, log.position - law.goal
    way = np.where(away > 0.0, robot.upper - law.goal, law.goal - robot.lower)
    position, velocity = np.max(np.abs(away) / way), np.max(np.abs(log.velocity) / robot.velocity_limit)
    return float(position), float(velocity), float(np.max(np.abs(log.torque) / robot.effort_limit))


def used(found: SafeSet, starts: int, level: float, given: argparse.Namespace, seed: int) -> np.ndarray:
    """Return what runs from the border of {H_d ≤ level} used of the limits, shape (starts, 3)."""
    law, rows = found.controller, []
    for first in range(0, starts, BATCH):
        q, v, z = found.border(min(BATCH, starts - first), seed=seed + first, level=level)
        outcomes = simulate_many(
            law.system, law, duration=given.duration, dt=given.dt, q0=q, v0=v, controller_state0=z, torque_limit=None,
            measure=partial(largest, law=law), progress=False,
        )  # fmt: skip
        for each in outcomes:
            if each.error:
                raise RuntimeError(each.error)
        rows += [each.value for each in outcomes]
    return np.array(rows)


def row(arm: str, name: str, given: argparse.Namespace) -> str:
    """Return what was found of one law on one arm."""
    system = MechanicalSystem(load_robot(arm, locked_joints=ARMS[arm]))
    law, began = make_controller(name, system, system.robot.near_home()), time.perf_counter()
    found, kinds = safe_set(law, keep=LAWS[name]), len(LAWS[name])
    most = used(found, given.starts, found.level, given, given.seed)[:, :kinds]
    broken, spent = int((most > 1.0).any(axis=1).sum()), time.perf_counter() - began
    larger = math.inf
    for factor in FACTORS if given.others else ():
        if (used(found, given.others, factor * found.level, given, 1)[:, :kinds] > 1.0).any():
            larger = factor
            break
    shares = ", ".join(f"{kind} {share:.1%}" for kind, share in zip(LAWS[name], most.max(axis=0), strict=True))
    beyond = f"; the first of {given.others} starts passes one from {larger:.3g} c" if given.others else ""
    return (
        f"{arm} {name}: c = {found.level:.4g} J ({found.binding}); {broken} of {given.starts} starts pass a limit in "
        f"{given.duration:g} s; used at most: {shares}; {spent:.0f} s{beyond}"
    )


def bounds(arm: str) -> str:
    """Return how far the proved bounds of 1/(M⁻¹)_ii are below the least that is seen at 4000 postures."""
    system, generator = MechanicalSystem(load_robot(arm, locked_joints=ARMS[arm])), np.random.default_rng(0)
    postures = (system.robot.random_position(generator) for _ in range(4000))
    seen = np.min([1.0 / (system.at(q).inverse_factor ** 2).sum(axis=0) for q in postures], axis=0)
    return f"{arm}: least 1/(M⁻¹)_ii seen over the proved bound: {np.round(seen / least_inertia(system), 1)}"


def main() -> None:
    """Print a line for each arm and law."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=100_000)
    parser.add_argument("--others", type=int, default=2_000)
    parser.add_argument("--duration", type=float, default=1.0)
    parser.add_argument("--dt", type=float, default=2e-3)
    parser.add_argument("--seed", type=int, default=0, help="of the first 5000 starts; later ones add their number")
    parser.add_argument("--arms", nargs="*", default=["panda", "pera"])
    parser.add_argument("--laws", nargs="*", default=list(LAWS))
    given = parser.parse_args()
    for arm in given.arms:
        print(bounds(arm), flush=True)
        for name in given.laws:
            print(row(arm, name, given), flush=True)


if __name__ == "__main__":
    main()
