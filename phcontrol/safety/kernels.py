"""The small linear algebra of the torque filter: compiled where it was built, else NumPy's; tested against each other.

    speed_bounds(q, v, h, edges, α, o, j, v_max, τ_r, v_r)     the lowest and the highest next velocity (``Limits``)
    expected_friction(v, d, F_v, hA)                           the dry friction torque of joints that nothing else moves
    passed_velocities(v, v_min, v_max, room, slow, fast)       writes between which velocities a period can pass
    narrowed_bounds(hA, s, s_min, s_max, v_min, v_max)         the same less what friction may do, and if any contradict
    bound_excess(v, v_min, v_max)                              by how much a velocity leaves its bounds
    motion_rows(E, reach, centre, drift, …, rows, lower, upper)  writes l ≤ C z ≤ u for the next velocity
    residuals(H, g, C, l, u, a, b, z, λ)                       how far z is from optimal (``Problem.residuals``)
    active_set_step(H, g, C, l, u, a, b, x, λ)                 solves for the constraints that x and λ say are active

Chosen together with ``phcontrol.mechanics.kernels``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from phcontrol.mechanics.kernels import KERNELS

__all__ = [
    "active_set_step",
    "bound_excess",
    "expected_friction",
    "motion_rows",
    "narrowed_bounds",
    "passed_velocities",
    "residuals",
    "speed_bounds",
]

if TYPE_CHECKING or KERNELS == "lapack":
    from phcontrol.safety._numpy import (
        active_set_step,
        bound_excess,
        expected_friction,
        motion_rows,
        narrowed_bounds,
        passed_velocities,
        residuals,
        speed_bounds,
    )
else:
    from phcontrol.safety._compiled import (
        active_set_step,
        bound_excess,
        expected_friction,
        motion_rows,
        narrowed_bounds,
        passed_velocities,
        residuals,
        speed_bounds,
    )
