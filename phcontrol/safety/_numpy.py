"""The kernels of the torque filter on NumPy: where no compiler was at hand, and as their own check."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from phcontrol._validation import Array


def speed_bounds(
    position: Array,
    velocity: Array,
    period: float,
    edges: Array,
    braking: Array,
    offset: Array,
    jerk: Array,
    velocity_limit: Array,
    return_time: float,
    return_speed: Array,
) -> tuple[Array, Array]:
    """Return the lowest and the highest next velocity; the arrays of 2n hold upper limits first, then lower ones."""
    n = position.size
    half_way = position + 0.5 * period * velocity
    room = edges - np.concatenate((half_way, -half_way))
    speed = np.concatenate((velocity, -velocity))
    lag = 0.5 * period * braking
    root = np.sqrt(2.0 * braking * np.maximum(room, 0.0) + (offset + lag) * (offset + lag))
    outside = room < 0.0
    stopping = np.where(outside, np.maximum(room / return_time, return_speed), root - (offset + lag))
    sinking = np.where(outside, 0.0, period * braking * np.maximum(speed, 0.0) / root)
    bound = np.minimum(
        _anticipating(stopping, speed - sinking, period, jerk), _anticipating(velocity_limit, speed, period, jerk)
    )
    lowest, highest = -bound[n:], bound[:n]
    contrary = lowest > highest  # a joint that is beyond a bound may brake as hard as that asks
    if contrary.any():
        down = velocity > highest
        lowest, highest = (
            np.where(contrary & down, highest, lowest),
            np.where(contrary & ~down, lowest, highest),
        )
    return lowest, highest


def _anticipating(bound: Array, speed: Array, period: float, jerk: Array) -> Array:
    """Return v⁺ = v + ha with v⁺ + a²/(2j) = bound for a speed v below the bound; else the bound."""
    result: Array = bound.copy()
    late = (bound > speed) & np.isfinite(jerk)
    below = bound[late] - speed[late]
    change = 2.0 * below / (1.0 + np.sqrt(1.0 + 2.0 * below / (jerk[late] * period * period)))
    result[late] = np.minimum(bound[late], speed[late] + change)
    return result


def expected_friction(velocity: Array, damping: Array, viscous: Array, response: Array) -> Array:
    """Return the dry torque (d − F_v)v of joints that nothing else moves, implicit in their own velocities."""
    dry = damping - viscous
    torque: Array = dry * velocity / (1.0 + response.diagonal() * dry)
    return torque


def passed_velocities(velocity: Array, lowest: Array, highest: Array, room: float, slow: Array, fast: Array) -> None:
    """Write the ends of the velocities passed towards the upper bound, towards the lower, and anywhere; 3n long each.

    They reach beyond the bounds by ``room``, and are finite: up to 1e9.
    """
    below, above = lowest - room, highest + room
    slow[:] = np.clip(np.minimum(np.tile(velocity, 3), np.concatenate((highest, below, below))), -1e9, 1e9)
    fast[:] = np.clip(np.maximum(np.tile(velocity, 3), np.concatenate((above, lowest, above))), -1e9, 1e9)


def narrowed_bounds(
    response: Array, expected: Array, least: Array, most: Array, lowest: Array, highest: Array
) -> tuple[Array, Array, bool]:
    """Return the bounds for a velocity predicted with the expected friction torque, whatever the true one does.

    ``least`` and ``most`` are for the passed velocities, 3n long. Also return whether some bounds are contradictory.
    """
    n = expected.size
    low, high = least[2 * n :], most[2 * n :]
    shift, spread = response.dot(expected - 0.5 * (low + high)), np.abs(response).dot(0.5 * (high - low))
    own = response.diagonal()
    narrow_low: Array = lowest + (spread - shift - own * (high - most[n : 2 * n]))
    narrow_high: Array = highest - (spread + shift - own * (least[:n] - low))
    return narrow_low, narrow_high, bool((narrow_low > narrow_high).any())


def bound_excess(velocity: Array, lowest: Array, highest: Array) -> float:
    """Return by how much a velocity leaves its bounds, 0 inside; NaN when there is one inside."""
    return max(float(np.maximum(velocity - highest, lowest - velocity).max()), 0.0)


def motion_rows(
    effect: Array,
    reach: Array,
    centre: Array,
    drift: Array,
    lowest: Array,
    highest: Array,
    preferred: Array,
    room: float,
    rows: Array,
    lower: Array,
    upper: Array,
) -> bool:
    """Write the first n rows of the program and their bounds; return whether the preferred torque keeps them."""
    n = reach.size
    scaled = effect * reach
    size = np.sqrt(np.add.reduce(scaled * scaled, axis=1))
    np.divide(scaled, size[:, None], out=rows[:n])
    start, reached, slack = drift + effect.dot(centre), drift + effect.dot(preferred), room * size
    keeps = bool(((reached >= lowest - slack) & (reached <= highest + slack)).all())
    if keeps:
        lowest, highest = np.minimum(lowest, reached - slack), np.maximum(highest, reached + slack)
    np.divide(lowest - start, size, out=lower[:n])
    np.divide(highest - start, size, out=upper[:n])
    return keeps


def residuals(
    hessian: Array | None,
    gradient: Array,
    rows: Array,
    lower: Array,
    upper: Array,
    lowest: Array,
    highest: Array,
    z: Array,
    multipliers: Array,
) -> tuple[float, float]:
    """Return by how much z and the rows' multipliers miss the two conditions of optimality."""
    downhill = multipliers.dot(rows) + gradient
    downhill += z if hessian is None else hessian.dot(z)
    stationary = np.minimum(np.maximum(z - downhill, lowest), highest) - z
    values = rows.dot(z)
    complementary = np.minimum(np.maximum(values + multipliers, lower), upper) - values
    return math.sqrt(stationary.dot(stationary)), math.sqrt(complementary.dot(complementary))


def active_set_step(
    hessian: Array | None,
    gradient: Array,
    rows: Array,
    lower: Array,
    upper: Array,
    lowest: Array,
    highest: Array,
    x: Array,
    multipliers: Array,
) -> tuple[Array, Array] | None:
    """Return x and multipliers with the active constraints of the given ones as equations; None if singular."""
    n = x.size
    active, equations, right, scale = active_equations(
        hessian, gradient, rows, lower, upper, lowest, highest, x, multipliers
    )
    if active.size > n or np.linalg.cond(equations) > 1e12:
        return None
    solution: Array = np.asarray(np.linalg.solve(equations, right), dtype=float)
    found = np.zeros_like(multipliers)
    found[active] = scale * solution[n:]
    return solution[:n], found


def active_equations(
    hessian: Array | None,
    gradient: Array,
    rows: Array,
    lower: Array,
    upper: Array,
    lowest: Array,
    highest: Array,
    x: Array,
    multipliers: Array,
) -> tuple[NDArray[np.intp], Array, Array, float]:
    """Return which constraints x and multipliers say are active, [[H/s, Aᵀ], [A, 0]] and [−g/s; b] with them, and s.

    s brings the objective to order one; it is the scale of the forces that the equations give.
    """
    identity = np.eye(x.size)
    constraints = np.vstack([rows, identity])
    low, high = np.append(lower, lowest), np.append(upper, highest)
    wanted = constraints.dot(x) + multipliers
    above, below = wanted > high, wanted < low
    active = np.flatnonzero(above | below)
    A, b = constraints[active], np.where(above, high, low)[active]
    scale = 1.0 if hessian is None else max(1.0, float(np.abs(hessian).max()))
    H = identity if hessian is None else hessian / scale
    equations = np.block([[H, A.T], [A, np.zeros((active.size, active.size))]])
    right: Array = np.append(-gradient / scale, b)
    return active, equations, right, scale
