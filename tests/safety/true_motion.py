"""The torque filter judged by the true motion of arms with dry friction.

    python -m tests.safety.true_motion --cases 1000000 --seed 1 [--error 0.3] [--check 100]

In each random case the filter's torque is held for one period, and the plant is integrated in steps of 10 µs with the
friction of every instant. Its velocity at the end must be inside the bounds that the filter was to keep, but for the
excess that it reported.

The motion of a batch of cases is integrated at once: inertia M and load C q̇ + ∂V/∂q are computed by Pinocchio at the
beginning, the middle and the end of the period and are parabolas of time in between, which is repeated with the motion
that results. ``--check N`` compares N cases with forward dynamics in steps of 1 µs.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pinocchio as pin

from phcontrol import InvalidArgumentError, Limits, MechanicalSystem, Robot, StribeckFriction, TorqueFilter, load_robot

CASES_EACH = 250  # with the same system and limits
STEP = 1e-5  # of the integration [s]
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
ARMS = ("z1", "xarm7", "tiago", "talos_arm", "panda", "pera")
ARMATURES = 10.0 ** np.linspace(-2.0, -1.0, 8)
"""[kg·m²], of which one is drawn: an arm with each is loaded once."""


@cache
def robot(name: str, armature: float) -> Robot:
    """Return an arm as the cases use it; PERA and Panda with the armature that they have."""
    if name == "panda":
        return load_robot(name, locked_joints=FINGERS)
    if name == "tiago":
        everything = load_robot(name).joint_names
        others = [joint for joint in everything if not (joint.startswith("arm_") and joint.endswith("_joint"))]
        return load_robot(name, locked_joints=others, armature=armature)
    return load_robot(name, armature=None if name == "pera" else armature)


def arm(name: str, armature: float = 0.01, coulomb: float = 0.5, static: float = 1.0) -> MechanicalSystem:
    """Return an arm with dry friction, of the panda ``coulomb`` [N·m], and ``static`` times that at rest."""
    if name != "panda":
        return MechanicalSystem(robot(name, armature))
    friction = StribeckFriction(coulomb=coulomb, static=static * coulomb, stribeck_velocity=0.2)
    return MechanicalSystem(robot(name, 0.0), friction=friction)


def random_arm(rng: np.random.Generator) -> MechanicalSystem:
    """Return one of the arms, with a random armature or friction."""
    name = ARMS[rng.integers(len(ARMS))]
    return arm(name, float(rng.choice(ARMATURES)), rng.choice([0.1, 0.5, 2.0]), rng.choice([1.0, 1.5]))


def random_limits(system: MechanicalSystem, rng: np.random.Generator) -> Limits | None:
    """Return random limits; None where the effort does not suffice for the torque rate that was drawn."""
    robot, n = system.robot, system.n
    rate = None if rng.random() < 0.4 else 10.0 ** rng.uniform(np.log10(300.0), np.log10(3000.0))
    reach = np.where(np.isinf(robot.upper - robot.lower), np.pi, 0.5 * (robot.upper - robot.lower))
    middle = np.where(np.isinf(robot.lower), 0.0, robot.lower) + reach
    try:
        return Limits(
            system,
            torque_rate=rate,
            velocity=robot.velocity_limit * rng.uniform(0.15, 1.5, n),
            lower=middle - reach * rng.uniform(0.3, 1.0, n),
            upper=middle + reach * rng.uniform(0.3, 1.0, n),
            braking_acceleration=rng.uniform(1.0, 10.0, n),
        )
    except InvalidArgumentError:
        return None


@dataclass
class Batch:
    """Cases with one system and period."""

    position: np.ndarray
    velocity: np.ndarray
    push: np.ndarray
    """G u + f_e [N·m]."""
    lowest: np.ndarray
    highest: np.ndarray
    excess: np.ndarray
    """What the filter reported [rad/s]."""


@dataclass
class Tally:
    """What was found."""

    cases: int = 0
    arms: Counter[str] = field(default_factory=Counter)
    statuses: Counter[str] = field(default_factory=Counter)
    excessive: int = 0
    """Cases with a motion excess above 1e-9 rad/s."""
    largest_excess: float = 0.0
    beyond: float = -np.inf
    """Largest true next velocity beyond bounds and reported excess [rad/s]."""
    beyond_frozen: float = -np.inf
    """The same with inertia and load as they were at the beginning of the period: what friction alone does."""
    above: Counter[float] = field(default_factory=Counter)
    """How many cases are beyond by more than so much [rad/s]."""
    above_frozen: Counter[float] = field(default_factory=Counter)
    """The same with inertia and load as they were: the rest of ``above`` is their change within the period."""
    relative: float = -np.inf
    """Largest part of the fastest joint's change of velocity, + 0.01 rad/s, by which a case is beyond."""
    relative_frozen: float = -np.inf
    """The same with inertia and load as they were."""


def draw(system: MechanicalSystem, filter_: TorqueFilter, rng: np.random.Generator, count: int, tally: Tally) -> Batch:
    """Draw cases and filter them."""
    n, limits, period = system.n, filter_.limits, filter_.period
    rows: list[tuple] = []
    width = limits.upper - limits.lower
    for _ in range(count):
        q = rng.uniform(limits.lower - 0.01 * width, limits.upper + 0.01 * width)
        near = rng.random(n) < 0.2
        edge = np.where(rng.random(n) < 0.5, limits.lower, limits.upper) + 10.0 ** rng.uniform(-5, -1, n) * rng.choice(
            [-1.0, 1.0], n
        )
        q = np.where(near, edge, q)
        v = limits.velocity * rng.uniform(-1.05, 1.05, n) * 10.0 ** rng.choice([0.0, -1.0, -2.0, -4.0], n)
        v = np.where(rng.random(n) < 0.1, 0.0, v)
        controlled = rng.random() < 0.6  # from where the bounds can mostly be kept
        if controlled:
            q = np.clip(q, limits.lower, limits.upper)
            v = np.clip(v, *limits.velocity_bounds(q, v, period)) * rng.choice([1.0, 0.99, 0.8])
        x = system.at(q, v)
        desired = limits.effort * rng.normal(size=n) * rng.choice([0.03, 0.3, 1.0, 5.0])
        if rng.random() < 0.3:
            desired = desired + x.potential_gradient
        previous = None if rng.random() < 0.2 else rng.uniform(-1.0, 1.0, n) * limits.effort
        if controlled:
            previous = x.potential_gradient + x.friction_torque
            previous = np.clip(previous + limits.torque_rate.clip(max=1e9) * period * rng.normal(size=n), *_box(limits))
        elif rng.random() < 0.5:
            previous = np.clip(desired + limits.torque_rate.clip(max=1e9) * period * rng.normal(size=n), *_box(limits))
        force = limits.effort * rng.normal(size=n) * rng.choice([0.0, 0.1])
        found = filter_.filter(x, desired, previous=previous, external_force=force)
        tally.statuses[found.status.name] += 1
        tally.excessive += found.motion_excess > 1e-9
        tally.largest_excess = max(tally.largest_excess, found.motion_excess)
        rows.append((q, v, found.torque + force, *limits.velocity_bounds(q, v, period), found.motion_excess))
    return Batch(*(np.array(column) for column in zip(*rows, strict=True)))


def _box(limits: Limits) -> tuple[np.ndarray, np.ndarray]:
    return -limits.effort, limits.effort


def next_velocity(system: MechanicalSystem, batch: Batch, period: float, friction) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocity after a period, shape (cases, n), and the same with inertia and load as at its beginning."""
    now = _dynamics(system, batch.position, batch.velocity)
    positions, velocities = _integrate(batch, [now[0]] * 3, [now[1]] * 3, period, friction)
    frozen = velocities[2]
    for _ in range(2):
        later = [_dynamics(system, q, v) for q, v in zip(positions[1:], velocities[1:], strict=True)]
        inverse, load = zip(now, *later, strict=True)
        positions, velocities = _integrate(batch, inverse, load, period, friction)
    return velocities[2], frozen


def _dynamics(system: MechanicalSystem, position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return M⁻¹ and C q̇ + ∂V/∂q of each case."""
    inertia, load = [], []
    for q, v in zip(position, velocity, strict=True):
        inertia.append(pin.crba(system.model, system.data, q).copy())
        load.append(pin.nonLinearEffects(system.model, system.data, q, v).copy())
    return np.linalg.inv(np.array(inertia)), np.array(load)


def _integrate(batch: Batch, inverse, load, period: float, friction) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return position and velocity at beginning, middle and end, by Runge and Kutta's method."""
    steps = round(period / STEP)
    dt = period / steps

    def parabola(values, s: float) -> np.ndarray:
        if values[0] is values[2]:
            return values[0]
        return values[0] * ((1 - s) * (1 - 2 * s)) + values[1] * (4 * s * (1 - s)) + values[2] * (s * (2 * s - 1))

    def at(s: float) -> tuple[np.ndarray, np.ndarray]:
        return parabola(inverse, s), batch.push - parabola(load, s)

    def rate(v: np.ndarray, point: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        total = point[1] - friction.coefficients(v) * v
        return np.matmul(point[0], total[:, :, None])[:, :, 0]

    q, v, begin = batch.position, batch.velocity, at(0.0)
    positions, velocities = [q], [v]
    for step in range(steps):
        middle, end = at((step + 0.5) / steps), at((step + 1) / steps)
        k1 = rate(v, begin)
        k2 = rate(v + 0.5 * dt * k1, middle)
        k3 = rate(v + 0.5 * dt * k2, middle)
        k4 = rate(v + dt * k3, end)
        new = v + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        q, v, begin = q + 0.5 * dt * (v + new), new, end
        if step + 1 in (steps // 2, steps):
            positions.append(q)
            velocities.append(v)
    return positions, velocities


def by_forward_dynamics(system: MechanicalSystem, batch: Batch, case: int, period: float, friction) -> np.ndarray:
    """Return the velocity of one case after a period, by the articulated-body algorithm in steps of 1 µs."""
    q, v, dt = batch.position[case].copy(), batch.velocity[case].copy(), 1e-6
    for _ in range(round(period / dt)):
        force = batch.push[case] - friction.coefficients(v) * v
        a = pin.aba(system.model, system.data, q, v, force)
        half = v + 0.5 * dt * a
        force = batch.push[case] - friction.coefficients(half) * half
        a = pin.aba(system.model, system.data, q + 0.5 * dt * v, half, force)
        q, v = q + dt * half, v + dt * a
    return v


def beyond(velocity: np.ndarray, batch: Batch) -> np.ndarray:
    """Return by how much each case is beyond its bounds and the reported excess [rad/s]."""
    over = np.maximum(velocity - batch.highest, batch.lowest - velocity).max(axis=1)
    return over - batch.excess


def run(cases: int, seed: int, *, error: float = 0.0, report=None) -> Tally:
    """Try random cases and return what was found; the plant's friction is wrong by up to ``error`` of itself."""
    rng, tally = np.random.default_rng(seed), Tally()
    while tally.cases < cases:
        system = random_arm(rng)
        limits = random_limits(system, rng)
        if limits is None:
            continue
        period = float(rng.choice([5e-4, 1e-3, 1e-3, 2e-3]))
        filter_ = TorqueFilter(system, period=period, limits=limits)
        batch = draw(system, filter_, rng, min(CASES_EACH, cases - tally.cases), tally)
        friction = system.friction if not error else system.friction.scaled(1.0 + error * rng.choice([-1.0, 1.0]))
        true, frozen = next_velocity(system, batch, period, friction)
        over, by_friction = beyond(true, batch), beyond(frozen, batch)
        tally.cases += len(over)
        tally.arms[system.robot.name] += len(over)
        tally.beyond = max(tally.beyond, float(over.max()))
        tally.beyond_frozen = max(tally.beyond_frozen, float(by_friction.max()))
        change = np.abs(true - batch.velocity).max(axis=1) + 0.01
        tally.relative = max(tally.relative, float((over / change).max()))
        tally.relative_frozen = max(tally.relative_frozen, float((by_friction / change).max()))
        for level in (1e-4, 1e-3, 1e-2, 1e-1):
            tally.above[level] += int((over > level).sum())
            tally.above_frozen[level] += int((by_friction > level).sum())
        if report is not None:
            report(tally, system, batch, over, true, frozen, friction, period)
    return tally


def main() -> None:
    """Run as many cases as asked for and print the tally."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--error", type=float, default=0.0, help="of the friction, as a part of it")
    parser.add_argument("--check", type=int, default=0, metavar="N", help="cases for forward dynamics as well")
    options = parser.parse_args()
    begin, checked, worst = time.monotonic(), 0, 0.0

    def report(tally, system, batch, over, true, frozen, friction, period) -> None:
        nonlocal checked, worst
        if checked < options.check:
            case = int(np.argmax(over))
            exact = by_forward_dynamics(system, batch, case, period, friction)
            checked, worst = checked + 1, max(worst, float(np.abs(exact - true[case]).max()))
            print(f"against forward dynamics in steps of 1 µs: {worst:.1e} rad/s in {checked} cases", flush=True)
        for case in np.flatnonzero(over > 1e-2):
            fast = np.abs(batch.velocity[case] / system.robot.velocity_limit).max()
            print(
                f"beyond: {system.robot.name} {over[case]:.2e}, frozen {beyond(frozen, batch)[case]:.2e}; "
                f"changes by {np.abs(true[case] - batch.velocity[case]).max():.3g} rad/s in {1e3 * period:g} ms, "
                f"excess {batch.excess[case]:.3g}, |q̇| {fast:.2f} of the robot's limit",
                flush=True,
            )
        if tally.cases % (40 * CASES_EACH) == 0:
            print(f"{time.monotonic() - begin:.0f} s: {tally}", flush=True)

    tally = run(options.cases, options.seed, error=options.error, report=report)
    print(f"{time.monotonic() - begin:.0f} s: {tally}")


if __name__ == "__main__":
    main()
