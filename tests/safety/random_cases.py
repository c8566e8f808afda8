"""Random cases of the torque filter against an exact solver, DAQP.

    python -m tests.safety.random_cases --cases 1000000 --seed 1

Everything the filter computes is computed here a second time, in torques that are not scaled, from Pinocchio's M, C
and g: the predicted velocity, what friction may do to it, its bounds, the braking torque, and the answer. DAQP solves
quadratic programs; the multiplier μ of the storage condition P(u) ≤ P_max, a parabola, is found as a root: with μP in
the objective the answer's P falls as μ grows.
"""

from __future__ import annotations

import argparse
import ctypes
from collections import Counter
from dataclasses import dataclass, field

import daqp
import numpy as np
import pinocchio as pin
from scipy.optimize import brentq

from phcontrol import MechanicalSystem, load_robot
from phcontrol.controllers.passive_port import PassivePort
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
    relaxed_wrongly: int = 0
    """Storage condition relaxed though it could be met by more than 1e-6 of the power at hand."""
    fallbacks_with_room: int = 0
    """Fallbacks whose storage condition could have been met."""
    reported_wrongly: float = 0.0
    """Largest error of the reported storage excess, relative to the power at hand."""
    gap: float = 0.0
    """Largest storage excess beyond the smallest possible one, relative to the power at hand."""


@dataclass
class Case:
    """One random case, as the reference sees it."""

    effect: np.ndarray
    drift: np.ndarray
    box: tuple[np.ndarray, np.ndarray]
    bounds: tuple[np.ndarray, np.ndarray]
    desired: np.ndarray
    kick: np.ndarray
    """v⁺ − q̇ without motors [rad/s]."""
    input_matrix: np.ndarray
    port: PassivePort
    scale: np.ndarray

    def mean_power(self, u: np.ndarray) -> float:
        """Return the mean of (G(u − u★))ᵀv̂ − resistanceᵀ(v̂ − v̂₀) − losses over the period, v̂ moving with q̇ [W]."""
        change, way = u - self.desired, self.kick + self.effect @ u
        middle = self.port.output + 0.5 * self.input_matrix.T @ way
        return float(middle @ change - 0.5 * way @ self.port.resistance - self.port.dissipated_power)

    @property
    def most(self) -> float:
        """Return the mean power that is allowed [W]."""
        return max(0.0, self.mean_power(self.desired))


def reference_case(system, limits, period, q, v, desired, previous, force, port) -> Case:
    """Return the problem in unscaled torques, by Pinocchio and the formulas written differently."""
    model, data = system.model, system.data
    M = pin.crba(model, data, q)
    load = pin.computeCoriolisMatrix(model, data, q, v) @ v + pin.computeGeneralizedGravity(model, data, q)
    for potential in system.potentials:
        load = load + potential.gradient(q)
    G = np.eye(system.n) if system.input_matrix is None else system.input_matrix
    lowest, highest = outer = reference_bounds(limits, period, q, v)
    inertia = M
    if system.friction is not None:
        inertia, torque, lowest, highest = reference_friction(system, period, M, v, lowest, highest)
        load = load + torque
    solve = np.linalg.inv(inertia)
    effect, drift = period * solve @ G, v + period * solve @ (force - load)
    low, high = -limits.effort, limits.effort
    if previous is not None:
        middle, reach = np.clip(previous, low, high), period * limits.torque_rate
        low, high = np.maximum(low, middle - reach), np.minimum(high, middle + reach)
    for i in np.flatnonzero(lowest > highest):
        at_upper, at_lower = v[i] > outer[1][i], v[i] < outer[0][i]
        target = highest[i] if at_upper else lowest[i] if at_lower else (lowest[i] + highest[i]) / 2
        lowest[i] = highest[i] = target
    slower = np.minimum(np.abs(v) / 0.1, limits.braking_acceleration) * period
    goal = np.clip(v - np.sign(v) * slower, lowest, highest)
    braking = np.linalg.solve(G, inertia @ (goal - v) / period - (force - load))
    braking = np.clip(braking, low, high)
    reached, sizes = drift + effect @ braking, np.linalg.norm(effect * (high - low) / 2, axis=1)
    if ((reached > highest + 1e-4 * sizes) | (reached < lowest - 1e-4 * sizes)).any():
        reached = least_excess(effect, drift, (low, high), (lowest, highest), sizes, braking)
    widened = np.minimum(lowest, reached - 1e-4 * sizes), np.maximum(highest, reached + 1e-4 * sizes)
    return Case(effect, drift, (low, high), widened, desired, drift - v, G, port, limits.effort)


def reference_friction(system, period, M, v, lowest, highest):
    """Return M + hθF_v, the friction torque expected, and the bounds less what friction may do beside that."""
    friction, n = system.friction, system.n
    viscous = np.broadcast_to(friction.viscous, n)
    x = period * viscous * np.linalg.inv(pin.crba(system.model, system.data, system.robot.home)).diagonal()
    implicit = np.where(x > 0.01, 1.0 / (1.0 - np.exp(-x)) - 1.0 / x, 0.5 + x / 12.0)  # the next term is x³/720
    inertia = M + np.diag(period * implicit * viscous)
    response = period * np.linalg.inv(inertia)

    def most_torque(joint, *speeds):
        """Return the largest sign and the largest size of the dry torque at velocities between the given ones."""
        a, b = min(speeds), max(speeds)
        static, coulomb, slow = (np.broadcast_to(part, n)[joint] for part in (
            friction.static, friction.coulomb, friction.stribeck_velocity))  # fmt: skip
        if b >= 0.0:
            size = coulomb + (static - coulomb) * np.exp(-max(a, 0.0) / slow)
        else:
            size = coulomb + (static - coulomb) * np.exp(a / slow)
        return size * b / np.sqrt(friction.smoothing + b * b)

    def range_of(joint, *speeds):
        return -most_torque(joint, *(-w for w in speeds)), most_torque(joint, *speeds)

    excess = friction.coefficients(v) - viscous
    expected = excess * v / (1.0 + response.diagonal() * excess)
    narrow_low, narrow_high = lowest.copy(), highest.copy()
    for i in range(n):
        for j in range(n):
            a, b = range_of(j, v[j], lowest[j] - 1e-3, highest[j] + 1e-3)
            if i == j:
                a = range_of(j, v[j], highest[j], highest[j] + 1e-3)[0]
                b = range_of(j, v[j], lowest[j], lowest[j] - 1e-3)[1]
            kicks = response[i, j] * (expected[j] - a), response[i, j] * (expected[j] - b)
            if i == j:
                narrow_high[i] -= kicks[0]
                narrow_low[i] -= kicks[1]
            else:
                narrow_high[i] -= max(kicks)
                narrow_low[i] -= min(kicks)
    return inertia, viscous * v + expected, narrow_low, narrow_high


def reference_bounds(limits, period, q, v) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest next velocity: stopping in front of the limits, with what turning takes."""
    alpha, jerk, h, bounds = limits.braking_acceleration, limits.braking_jerk, period, []

    def turning(bound, speed):
        """Solve h·a + a²/(2j) = bound − speed for a ≥ 0; v⁺ = speed + h·a."""
        way = np.maximum(bound - speed, 0.0)
        with np.errstate(invalid="ignore"):
            a = np.where(np.isinf(jerk), way / h, -jerk * h + np.sqrt((jerk * h) ** 2 + 2.0 * jerk * way))
        return np.where(bound > speed, speed + h * a, bound)

    for side in (1.0, -1.0):
        edge = limits.upper if side > 0 else -limits.lower
        room, speed = edge - side * (q + 0.5 * h * v), side * v
        inside = np.maximum(room, 0.0)
        stopping = 2.0 * inside / (0.5 * h + np.sqrt((0.5 * h) ** 2 + 2.0 * inside / alpha))
        returning = -np.minimum(np.minimum(0.25 * limits.velocity, 0.5), np.maximum(-room, 0.0) / 0.05)
        falling = np.where(room >= 0.0, np.maximum(speed, 0.0) / (stopping / alpha + 0.5 * h), 0.0)
        place = turning(np.where(room >= 0.0, stopping, returning), speed - h * falling)
        bounds.append(side * np.minimum(place, turning(limits.velocity, speed)))
    highest, lowest = bounds
    contrary = lowest > highest
    return (
        np.where(contrary & (v > highest), highest, lowest),
        np.where(contrary & (v <= highest), lowest, highest),
    )


def least_excess(effect, drift, box, bounds, sizes, braking) -> np.ndarray:
    """Return the velocity that leaves its bounds least: 10⁴|excess/sizes|² + |distance from braking|² is smallest."""
    n = drift.size
    centre, reach = (box[0] + box[1]) / 2, (box[1] - box[0]) / 2
    rows, start = effect * reach / sizes[:, None], drift + effect @ centre
    beyond = np.abs(rows).sum(axis=1) + 1.0
    low = np.minimum((bounds[0] - start) / sizes, beyond)
    high = np.maximum((bounds[1] - start) / sizes, -beyond)
    free = np.full(n, 1e30)
    z, _, flag, _ = daqp.solve(
        np.diag(np.concatenate([np.ones(n), np.full(n, 1e4)])),
        np.concatenate([-(braking - centre) / reach, np.zeros(n)]),
        np.hstack([rows, np.eye(n)]),
        np.concatenate([np.ones(n), free, high]),
        np.concatenate([-np.ones(n), -free, low]),
        np.zeros(3 * n, dtype=ctypes.c_int),
        primal_tol=1e-12,
        dual_tol=1e-12,
    )
    return start + sizes * (rows @ z[:n]) if flag == 1 else drift + effect @ braking


def nearest(case: Case, weight: float, *, distance: float = 1.0) -> np.ndarray | None:
    """Return DAQP's minimum of distance·½|u − u★|²_W + weight·P(u)/size inside the linear limits, or None."""
    n = case.desired.size
    centre, reach = (case.box[0] + case.box[1]) / 2, (case.box[1] - case.box[0]) / 2  # DAQP wants numbers of order one
    weights = (reach / case.scale) ** 2
    weights = weights / weights.mean()
    bend = case.input_matrix.T @ case.effect
    slope = np.array([case.mean_power(centre + reach * e) - case.mean_power(centre - reach * e) for e in np.eye(n)]) / 2
    hessian = distance * np.diag(weights) + weight / size_of(case) * reach[:, None] * 0.5 * (bend + bend.T) * reach
    gradient = -distance * weights * (case.desired - centre) / reach + weight / size_of(case) * slope
    drift = case.drift + case.effect @ centre
    rows, low, high = case.effect * reach, case.bounds[0] - drift, case.bounds[1] - drift
    size, unit = np.linalg.norm(rows, axis=1), max(1.0, float(np.linalg.norm(gradient)))
    z, _, flag, _ = daqp.solve(
        hessian / unit,
        gradient / unit,
        rows / size[:, None],
        np.concatenate([np.ones(n), high / size]),
        np.concatenate([-np.ones(n), low / size]),
        np.zeros(2 * n, dtype=ctypes.c_int),
        primal_tol=1e-12,
        dual_tol=1e-12,
    )
    return centre + reach * z if flag == 1 else None


def size_of(case: Case) -> float:
    """Return the scale of P near the clipped torque, as the filter's docstring has it [W]."""
    reach = (case.box[1] - case.box[0]) / 2
    clipped = np.clip(case.desired, *case.box)
    steps = 1e-3 * reach
    slope = [(case.mean_power(clipped + s) - case.mean_power(clipped - s)) / 2e-3 for s in np.diag(steps)]
    return float(np.abs(slope).sum() + (reach**2 * (case.input_matrix.T @ case.effect).diagonal()).sum())


def exact(case: Case) -> np.ndarray | None:
    """Return the nearest torque inside all limits, or None when DAQP finds none."""
    best = nearest(case, 0.0)
    if best is None or case.mean_power(best) <= case.most:
        return best

    def surplus(logarithm: float) -> float:
        u = nearest(case, np.exp(logarithm))
        return np.nan if u is None else (case.mean_power(u) - case.most) / size_of(case)

    high = 0.0
    while surplus(high) > 0.0:
        high += 3.0
        if high > 30.0:
            return None
    low = high - 3.0
    while surplus(low) < 0.0:
        low -= 3.0
        if low < -40.0:
            return None
    root = brentq(surplus, low, high, xtol=1e-12, rtol=1e-14)
    return nearest(case, np.exp(root))


def smallest_supply(case: Case) -> float:
    """Return the least mean power that effort, rate and velocity bounds allow [W]."""
    u = nearest(case, 1.0, distance=0.0)
    return np.inf if u is None else case.mean_power(u)


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
            braking_jerk=np.inf if rate is None else 10.0 ** rng.uniform(1.0, 5.0, n),
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
    desired = limits.effort * rng.normal(size=n) * rng.choice([0.1, 0.5, 1.0, 5.0])
    if rng.random() < 0.3:
        desired = desired + x.potential_gradient
    previous = None if rng.random() < 0.2 else rng.uniform(-1.0, 1.0, n) * limits.effort
    force = limits.effort * rng.normal(size=n) * rng.choice([0.0, 0.1])
    output = v + rng.normal(size=n) * rng.choice([0.0, 0.3])
    losses = float(rng.exponential()) * float(rng.choice([0.0, 1.0, 30.0]))
    port = PassivePort(output, losses, rng.choice([0.0, 0.3]) * limits.effort * rng.normal(size=n))
    found = filter_.filter(x, desired, previous=previous, external_force=force, port=port)
    case = reference_case(system, limits, period, q, v, desired, previous, force, port)
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
    at_hand = 1.0 + size_of(case)
    excess = (case.mean_power(u) - case.most) / at_hand
    reported = (found.storage_excess - max(0.0, case.mean_power(u) - case.most)) / at_hand
    tally.reported_wrongly = max(tally.reported_wrongly, abs(reported))
    if found.status == FilterStatus.FALLBACK:
        tally.fallbacks_with_room += smallest_supply(case) <= case.most
        return
    tally.motion_error = max(tally.motion_error, motion)
    if found.status != FilterStatus.STORAGE_RELAXED:
        tally.storage_error = max(tally.storage_error, excess)
        if found.status == FilterStatus.FEASIBLE:
            return
        answer = exact(case)
    else:
        least = smallest_supply(case)
        tally.relaxed_wrongly += least - case.most < -1e-6 * at_hand
        tally.gap = max(tally.gap, excess - max(0.0, (least - case.most) / at_hand))
        answer = nearest(case, 1e6)
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
