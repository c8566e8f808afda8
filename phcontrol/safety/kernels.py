"""The small linear algebra of the torque filter: compiled where it was built, else NumPy's; tested against each other.

How the arm moves in a period:

    predicted_motion(v, M, C, ∂V/∂q, F_v, hθF_v, f_e, h)       M + hθF_v, h times its inverse, and what moves the arm
    moved(v, hA, f)                                            v + hA f
    speed_bounds(q, v, h, edges, α, o, j, v_max, τ_r, v_r)     the lowest and the highest next velocity (``Limits``)
    expected_friction(v, d, F_v, hA)                           the dry friction torque of joints that nothing else moves
    passed_velocities(v, v_min, v_max, room, slow, fast)       writes between which velocities a period can pass
    narrowed_bounds(hA, s, s_min, s_max, v_min, v_max)         the same less what friction may do, and if any contradict
    bound_excess(v, v_min, v_max)                              by how much a velocity leaves its bounds
    braking_torque(v, M, f, v_min, v_max, Δv_max, h, decay)    brakes into the bounds, or damps between them

Torques u and z = (u − centre)/reach:

    nearest_torque(u, low, high)                               u within its bounds, and whether that is u
    torque_range(u₀, limit, step)                              low, high, centre and reach by effort and rate
    scaled(u, centre, reach, most), torque_at(z, …, low, high) z of u, and whether that is not beyond most; u of z
    effort_metric(reach, scale)                                the weights of |u/scale|² for z
    motion_rows(E, reach, centre, drift, …, rows, lower, upper)  writes l ≤ C z ≤ u for the next velocity

The program, min ½zᵀH z + gᵀz in l ≤ C z ≤ u and a ≤ z ≤ b, and the storage condition, a parabola e + gᵀ(z − c) + …:

    residuals(H, g, C, l, u, a, b, z, λ)                       how far z is from optimal (``Problem.residuals``)
    active_set_step(H, g, C, l, u, a, b, x, λ)                 solves for the constraints that x and λ say are active
    bent(H, g, weight, K, z, slope)                            the objective with a parabola, weighed, in it
    parabola(z, c, e, g, K), tangent(z, c, e, g, K)            its value; row, bound and length of its tangent
    farther(H, g, z, b)                                        the most by which the objective is larger in the box
    mean_power(ŷ, r, d, Δ, κ, GΔ)                              P of ``StorageCondition``
    storage_parabola(ŷ, r, GΔ, κ, E, K, reach)                 its size, slope and curvature for z
    elastic_bounds(C, l, u, b, z₀), widen(C, z, room, l, u)    for ``LeastExcess``, and with its answer

Chosen together with ``phcontrol.mechanics.kernels``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from phcontrol.mechanics.kernels import KERNELS

__all__ = [
    "active_set_step",
    "bent",
    "bound_excess",
    "braking_torque",
    "effort_metric",
    "elastic_bounds",
    "expected_friction",
    "farther",
    "mean_power",
    "motion_rows",
    "moved",
    "narrowed_bounds",
    "nearest_torque",
    "parabola",
    "passed_velocities",
    "predicted_motion",
    "residuals",
    "scaled",
    "speed_bounds",
    "storage_parabola",
    "tangent",
    "torque_at",
    "torque_range",
    "widen",
]

if TYPE_CHECKING or KERNELS == "lapack":
    from phcontrol.safety._numpy import (
        active_set_step,
        bent,
        bound_excess,
        braking_torque,
        effort_metric,
        elastic_bounds,
        expected_friction,
        farther,
        mean_power,
        motion_rows,
        moved,
        narrowed_bounds,
        nearest_torque,
        parabola,
        passed_velocities,
        predicted_motion,
        residuals,
        scaled,
        speed_bounds,
        storage_parabola,
        tangent,
        torque_at,
        torque_range,
        widen,
    )
else:
    from phcontrol.safety._compiled import (
        bound_excess,
        braking_torque,
        effort_metric,
        expected_friction,
        motion_rows,
        moved,
        narrowed_bounds,
        nearest_torque,
        passed_velocities,
        predicted_motion,
        scaled,
        speed_bounds,
        torque_at,
        torque_range,
    )
    from phcontrol.safety._compiled_program import (
        active_set_step,
        bent,
        elastic_bounds,
        farther,
        mean_power,
        parabola,
        residuals,
        storage_parabola,
        tangent,
        widen,
    )
