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
) -> tuple[Array, Array, Array, float, float] | None:
    """Return x and multipliers with the active constraints of the given ones as equations; None if singular.

    Also return x within the box, and the residuals that it has there with these multipliers.
    """
    n = x.size
    active, equations, right, scale = active_equations(
        hessian, gradient, rows, lower, upper, lowest, highest, x, multipliers
    )
    if active.size > n or np.linalg.cond(equations) > 1e12:
        return None
    solution: Array = np.asarray(np.linalg.solve(equations, right), dtype=float)
    found = np.zeros_like(multipliers)
    found[active] = scale * solution[n:]
    inside = np.minimum(np.maximum(solution[:n], lowest), highest)
    missed = residuals(hessian, gradient, rows, lower, upper, lowest, highest, inside, found[: lower.size])
    return solution[:n], found, inside, *missed


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


def bent(
    hessian: Array | None, gradient: Array, weight: float, curvature: Array, z: Array, slope: Array | None
) -> tuple[Array, Array]:
    """Return the objective with ½·weight·(y − z)ᵀK(y − z) more in it, and weight·slopeᵀy where a slope is given."""
    curvature = weight * curvature
    gradient = gradient - curvature.dot(z)
    if slope is not None:
        gradient = gradient + weight * slope
    return curvature + (np.eye(z.size) if hessian is None else hessian), gradient


def parabola(z: Array, centre: Array, excess: float, slope: Array, curvature: Array) -> float:
    """Return excess + slopeᵀ(z − centre) + ½(z − centre)ᵀK(z − centre)."""
    way = z - centre
    return excess + float(way.dot(slope + 0.5 * curvature.dot(way)))


def tangent(z: Array, centre: Array, excess: float, slope: Array, curvature: Array) -> tuple[Array, float, float]:
    """Return row, bound and length of the tangent of that at z: the row has length one, but where it is 0."""
    row = slope + curvature.dot(z - centre)
    length = math.sqrt(row.dot(row))
    bound = float(row.dot(z)) - parabola(z, centre, excess, slope, curvature)
    return (row / length, bound / length, length) if length > 0.0 else (row, bound, length)


def farther(hessian: Array | None, gradient: Array, z: Array, highest: Array) -> float:
    """Return the most by which ½yᵀH y + gᵀy can be larger than at z for a y of the box |y| ≤ highest."""
    H = np.eye(z.size) if hessian is None else hessian
    near = 0.5 * z.dot(H.dot(z)) + gradient.dot(z)
    return float(0.5 * highest.dot(np.abs(H).dot(highest)) + np.abs(gradient).dot(highest) - near)


def mean_power(output: Array, resistance: Array, dissipated: float, change: Array, kick: Array, push: Array) -> float:
    """Return ŷᵀΔ − d + ½κᵀ(GΔ − r)."""
    return float(output.dot(change) + 0.5 * kick.dot(push - resistance)) - dissipated


def storage_parabola(
    output: Array, resistance: Array, push: Array, kick: Array, effect: Array, curvature: Array, reach: Array
) -> tuple[float, Array, Array]:
    """Return the size of slope and curvature of the mean power by z, and both divided by it."""
    slope = reach * (0.5 * ((push - resistance).dot(effect) + kick) + output)
    curvature = curvature * reach * reach[:, None]
    size = float(np.abs(slope).sum()) + float(curvature.trace())
    return (size, slope / size, curvature / size) if size > 0.0 else (size, slope, curvature)


def elastic_bounds(
    rows: Array, lower: Array, upper: Array, highest: Array, preferred: Array
) -> tuple[Array, Array, Array]:
    """Return bounds that are at most 1 beyond the box's reach, and (z, s) near the preferred z that meet them."""
    beyond = np.abs(rows).dot(highest) + 1.0
    low, high = np.minimum(lower, beyond), np.maximum(upper, -beyond)
    z = np.minimum(np.maximum(preferred, -highest), highest)
    reached = rows.dot(z)
    return low, high, np.concatenate([z, np.minimum(np.maximum(reached, low), high) - reached])


def widen(rows: Array, z: Array, room: float, lower: Array, upper: Array) -> None:
    """Widen the bounds so far that z is within them by ``room``."""
    reached = rows.dot(z)
    np.minimum(lower, reached - room, out=lower)
    np.maximum(upper, reached + room, out=upper)


def nearest_torque(torque: Array, low: Array, high: Array) -> tuple[Array, bool]:
    """Return the torque nearest to one within bounds, and whether it is that torque; NaN stays NaN."""
    nearest: Array = np.minimum(np.maximum(torque, low), high)
    return nearest, bool((nearest == torque).all())


def torque_range(previous: Array, limit: Array, step: Array) -> tuple[Array, Array, Array, Array]:
    """Return the lowest and the highest torque by effort and rate, their middle and half their distance."""
    start = nearest_torque(previous, -limit, limit)[0]
    low, high = np.maximum(start - step, -limit), np.minimum(start + step, limit)
    return low, high, 0.5 * (low + high), 0.5 * (high - low)


def predicted_motion(
    velocity: Array,
    mass: Array,
    coriolis: Array,
    gradient: Array,
    viscous: Array | None,
    implicit: Array | None,
    external: Array | None,
    period: float,
) -> tuple[Array, Array, Array]:
    """Return M + hθF_v, h times its inverse, and f_e − C q̇ − F_v q̇ − ∂V/∂q."""
    force = coriolis.dot(velocity) + gradient
    if viscous is not None:
        force += viscous * velocity
    inertia = np.array(mass) if implicit is None else mass + np.diag(implicit)
    try:
        factor = np.linalg.cholesky(inertia)
    except np.linalg.LinAlgError as error:
        raise ArithmeticError("the inertia must be positive definite") from error
    if not np.isfinite(factor).all():
        raise ArithmeticError("the inertia must be positive definite")
    inverse = np.linalg.inv(factor)
    return inertia, period * inverse.T.dot(inverse), -force if external is None else external - force


def moved(velocity: Array, response: Array, push: Array) -> Array:
    """Return the next velocity, v + (response)(push)."""
    result: Array = velocity + response.dot(push)
    return result


def braking_torque(
    velocity: Array,
    inertia: Array,
    force: Array,
    lowest: Array,
    highest: Array,
    fastest: Array,
    period: float,
    decay: float,
) -> Array:
    """Return the generalised force that changes v by −decay·v, by no more than ``fastest``, into the bounds."""
    change = np.minimum(np.maximum(-decay * velocity, -fastest), fastest)
    change = np.minimum(np.maximum(change, lowest - velocity), highest - velocity)
    result: Array = inertia.dot(change / period) - force
    return result


def scaled(torque: Array, centre: Array, reach: Array, most: float) -> tuple[Array, bool]:
    """Return (torque − centre)/reach, as far as ``most``, and whether it is no farther."""
    z = (torque - centre) / reach
    return np.minimum(np.maximum(z, -most), most), bool((np.abs(z) <= most).all())


def torque_at(z: Array, centre: Array, reach: Array, low: Array, high: Array) -> Array:
    """Return centre + reach·z, exactly within the bounds."""
    result: Array = np.minimum(np.maximum(centre + reach * z, low), high)
    return result


def effort_metric(reach: Array, scale: Array) -> Array:
    """Return the diagonal matrix of (reach/scale)², divided by their mean."""
    weights = (reach / scale) ** 2
    return np.diag(weights / weights.mean())
