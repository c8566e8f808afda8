"""Random cases of the torque filter against exact solvers: DAQP for the answer, HiGHS for what is possible.

    python -m tests.safety.random_cases --cases 1000000 --seed 1

Everything the filter computes is computed here a second time, in torques that are not scaled, from Pinocchio's M, C
and g: the predicted velocity, its bounds, the braking torque, and the answer.
"""

from __future__ import annotations

import argparse
import ctypes
from collections import Counter
from dataclasses import dataclass, field

import daqp
import numpy as np
import pinocchio as pin
from scipy.optimize import linprog

from phcontrol import MechanicalSystem, load_robot
from phcontrol.controllers.controller import PassivePort
from phcontrol.safety.limits import Limits
from phcontrol.safety.torque_filter import FilterStatus, TorqueFilter

CASES_EACH = 250  # with the same system and limits
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")


def systems() -> list[MechanicalSystem]:
    """Return arms of two to seven joints, with and without friction and gears."""
    rng = np.random.default_rng(5)
    return [
        MechanicalSystem(load_robot("panda", locked_joints=FINGERS)),
        MechanicalSystem(load_robot("pera")),
        MechanicalSystem(load_robot("pera"), friction=None),
        MechanicalSystem(load_robot("ur5")),
        MechanicalSystem(load_robot("pera_shoulder")),
        MechanicalSystem(load_robot("pera_shoulder_elbow"), input_matrix=np.eye(3) + 0.3 * rng.normal(size=(3, 3))),
    ]


@dataclass
class Tally:
    """What was found."""

    statuses: Counter[str] = field(default_factory=Counter)
    relaxed: int = 0
    """Cases whose velocity bounds could not all be kept."""
    hard_excess: float = 0.0
    """Largest excess over effort and rate limits [N·m]."""
    torque_error: float = 0.0
    """Largest difference from the exact answer [N·m]."""
    motion_error: float = 0.0
    """Largest excess over the (widened) velocity bounds in an answer of the solver [rad/s]."""
    storage_error: float = 0.0
    """Largest storage excess of a torque that claims to meet the condition, relative to 1 W + the power at hand."""
    given_up_wrongly: int = 0
    """Storage condition given up though it could be met by more than 1e-6 of the power at hand."""
    fallbacks_with_room: int = 0
    """Fallbacks whose storage condition could have been met."""
    gap: float = 0.0
    """Largest storage excess beyond the smallest possible one, relative to the power at hand."""


@dataclass
class Case:
    """One random case, as the reference sees it."""

    effect: np.ndarray
    drift: np.ndarray
    box: tuple[np.ndarray, np.ndarray]
    bounds: tuple[np.ndarray, np.ndarray]
    wish: np.ndarray
    output: np.ndarray
    power: float
    scale: np.ndarray


def reference_case(system, limits, period, q, v, wish, previous, force, port) -> Case:
    """Return the problem in unscaled torques, by Pinocchio and the formulas written differently."""
    model, data = system.model, system.data
    M = pin.crba(model, data, q)
    load = pin.computeCoriolisMatrix(model, data, q, v) @ v + pin.computeGeneralizedGravity(model, data, q)
    for potential in system.potentials:
        load = load + potential.gradient(q)
    D = np.zeros_like(M) if system.friction is None else np.diag(system.friction.coefficients(v))
    G = np.eye(system.n) if system.input_matrix is None else system.input_matrix
    solve = np.linalg.inv(M + period * D)
    effect, drift = period * solve @ G, v + period * solve @ (force - load - D @ v)
    low, high = -limits.effort, limits.effort
    if previous is not None:
        middle, reach = np.clip(previous, low, high), period * limits.torque_rate
        low, high = np.maximum(low, middle - reach), np.minimum(high, middle + reach)
    alpha = limits.braking_acceleration
    tau = np.where(np.isinf(limits.torque_rate), 0.0, 2.0 * limits.effort / limits.torque_rate)
    bounds = []
    for side in (1.0, -1.0):
        edge = limits.upper if side > 0 else -limits.lower
        room = edge - side * (q + 0.5 * period * v)
        b = tau + 0.5 * period
        stopping = 2.0 * np.maximum(room, 0.0) / (b + np.sqrt(b**2 + 2.0 * np.maximum(room, 0.0) / alpha))
        returning = -np.minimum(np.minimum(0.25 * limits.velocity, 0.5), np.maximum(-room, 0.0) / 0.05)
        bounds.append(side * np.minimum(np.where(room >= 0.0, stopping, returning), limits.velocity))
    highest, lowest = bounds
    slower = np.minimum(np.abs(v) / 0.1, alpha) * period
    goal = np.clip(v - np.sign(v) * slower, lowest, highest)
    braking = np.linalg.solve(G, (M + period * D) @ (goal - v) / period - (force - load - D @ v))
    held = (braking < low) | (braking > high)
    braking = np.clip(braking, low, high)
    while held.any() and not held.all():  # the motors that are left bring their own joints where they should be
        A = np.where(held[:, None], np.eye(system.n), effect)
        wanted = np.linalg.solve(A, np.where(held, braking, goal - drift))
        braking, before = np.where(held, braking, np.clip(wanted, low, high)), held
        held = held | (wanted < low) | (wanted > high)
        if (held == before).all():
            break
    reached = drift + effect @ braking
    room = 1e-4 * np.linalg.norm(effect * (high - low) / 2, axis=1)
    widened = np.minimum(lowest, reached - room), np.maximum(highest, reached + room)
    return Case(effect, drift, (low, high), widened, wish, port.output, port.dissipated_power, limits.effort)


def exact(case: Case, insist: float = 0.0) -> np.ndarray | None:
    """Return DAQP's answer, or None when it says that there is none; ``insist`` replaces condition 4 by its weight."""
    n = case.wish.size
    centre, reach = (case.box[0] + case.box[1]) / 2, (case.box[1] - case.box[0]) / 2  # DAQP wants numbers of order one
    weights = (reach / case.scale) ** 2
    weights = weights / weights.mean()
    gradient = -weights * (case.wish - centre) / reach
    drift = case.drift + case.effect @ centre
    rows, low, high = [case.effect * reach], [case.bounds[0] - drift], [case.bounds[1] - drift]
    if insist:
        gradient = gradient + insist * case.output * reach / np.linalg.norm(case.output * reach)
    else:
        rows.append((case.output * reach)[None])
        low.append([-1e30])
        high.append([case.power + case.output @ (case.wish - centre)])
    rows, low, high = np.vstack(rows), np.concatenate(low), np.concatenate(high)
    size = np.linalg.norm(rows, axis=1)
    z, _, flag, _ = daqp.solve(
        np.diag(weights),
        gradient,
        rows / size[:, None],
        np.concatenate([np.ones(n), high / size]),
        np.concatenate([-np.ones(n), low / size]),
        np.zeros(n + len(rows), dtype=ctypes.c_int),
        primal_tol=1e-11,
        dual_tol=1e-11,
    )
    return centre + reach * z if flag == 1 else None


def smallest_supply(case: Case) -> float:
    """Return the least ŷᵀ(u − u★) that effort, rate and velocity bounds allow, by linear programming [W]."""
    centre, reach = (case.box[0] + case.box[1]) / 2, (case.box[1] - case.box[0]) / 2
    cost = case.output * reach
    size = np.abs(cost).max()
    drift = case.drift + case.effect @ centre
    A = np.vstack([case.effect, -case.effect]) * reach
    b = np.concatenate([case.bounds[1] - drift, drift - case.bounds[0]])
    lengths = np.linalg.norm(A, axis=1)
    result = linprog(cost / size, A / lengths[:, None], b / lengths, bounds=(-1.0, 1.0), method="highs")
    return float(result.fun * size - case.output @ (case.wish - centre)) if result.status == 0 else np.inf


def run(cases: int, seed: int, report=None) -> Tally:
    """Try random cases and return what was found."""
    rng, tally, arms = np.random.default_rng(seed), Tally(), systems()
    for block in range(-(-cases // CASES_EACH)):
        system = arms[rng.integers(len(arms))]
        n, robot = system.n, system.robot
        effort = robot.effort_limit * rng.uniform(0.8, 1.5, n)
        rate = None if rng.random() < 0.5 else effort * rng.choice([10.0, 100.0, 1000.0])
        reach = np.where(np.isinf(robot.upper - robot.lower), np.pi, 0.5 * (robot.upper - robot.lower))
        middle = np.where(np.isinf(robot.lower), 0.0, robot.lower) + reach
        limits = Limits(
            system,
            effort=effort,
            torque_rate=rate,
            velocity=robot.velocity_limit * rng.uniform(0.3, 2.0, n),
            lower=middle - reach * rng.uniform(0.3, 1.0, n),
            upper=middle + reach * rng.uniform(0.3, 1.0, n),
            braking_acceleration=rng.uniform(1.0, 10.0, n),
        )
        filter_ = TorqueFilter(system, period=float(rng.choice([1e-3, 2e-3, 1e-2])), limits=limits)
        for _ in range(min(CASES_EACH, cases - block * CASES_EACH)):
            try_case(system, filter_, rng, tally)
        if report and block % 40 == 39:
            report(tally)
    return tally


def try_case(system, filter_: TorqueFilter, rng, tally: Tally) -> None:
    """Draw one case, filter it, and compare."""
    n, limits, period = system.n, filter_.limits, filter_.period
    width = limits.upper - limits.lower
    q = rng.uniform(limits.lower - 0.02 * width, limits.upper + 0.02 * width)
    v = limits.velocity * rng.uniform(-1.1, 1.1, n) * rng.choice([0.1, 1.0])
    x = system.at(q, v)
    wish = limits.effort * rng.normal(size=n) * rng.choice([0.1, 0.5, 1.0, 5.0])
    if rng.random() < 0.3:
        wish = wish + x.potential_gradient
    previous = None if rng.random() < 0.2 else rng.uniform(-1.0, 1.0, n) * limits.effort
    force = limits.effort * rng.normal(size=n) * rng.choice([0.0, 0.1])
    output = v + rng.normal(size=n) * rng.choice([0.0, 0.3])
    port = PassivePort(output, float(rng.exponential()) * float(rng.choice([0.0, 1.0, 30.0])))
    found = filter_.filter(x, wish, previous=previous, external_force=force, port=port)
    case = reference_case(system, limits, period, q, v, wish, previous, force, port)
    u = found.torque
    assert np.isfinite(u).all()
    tally.statuses[found.status.name] += 1
    tally.relaxed += found.motion_excess > 1e-9
    hard = max(np.abs(u) - limits.effort)
    if previous is not None:
        hard = max(hard, *(np.abs(u - np.clip(previous, -limits.effort, limits.effort)) - period * limits.torque_rate))
    tally.hard_excess = max(tally.hard_excess, hard)
    next_velocity = case.drift + case.effect @ u
    motion = max((next_velocity - case.bounds[1]).max(), (case.bounds[0] - next_velocity).max())
    at_hand = 1.0 + float(np.abs(case.output * limits.effort).sum())
    excess = (float(case.output @ (u - wish)) - case.power) / at_hand
    if found.status == FilterStatus.FALLBACK:
        tally.fallbacks_with_room += smallest_supply(case) <= case.power
        return
    tally.motion_error = max(tally.motion_error, motion)
    if found.status != FilterStatus.STORAGE_GIVEN_UP:
        tally.storage_error = max(tally.storage_error, excess)
        if found.status == FilterStatus.FEASIBLE:
            return
        answer = exact(case)
    else:
        least = smallest_supply(case)
        tally.given_up_wrongly += least - case.power < -1e-6 * at_hand
        tally.gap = max(tally.gap, excess - max(0.0, (least - case.power) / at_hand))
        answer = exact(case, insist=1e4)
    if answer is None:
        tally.statuses["no answer by DAQP"] += 1
        return
    error = float(np.abs(u - answer).max())
    if error > 1e-5:
        tally.statuses[f"{found.status.name} differs"] += 1
        COMPLAINTS.append((found, case, answer, error))
    tally.torque_error = max(tally.torque_error, error)


COMPLAINTS: list = []


def main() -> None:
    """Run as many cases as asked for and print the tally."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    tally = run(options.cases, options.seed, lambda tally: print(tally, flush=True))
    print(tally)


if __name__ == "__main__":
    main()
