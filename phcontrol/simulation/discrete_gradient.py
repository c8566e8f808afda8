"""A step that keeps the power balance of the arm exactly, whatever its length."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.simulation.dynamics import Dynamics
from phcontrol.simulation.fixed_point import fixed_point

_ROUNDING = 8.0 * float(np.finfo(float).eps)  # of the energies, below which a difference of them is none


def discrete_gradient(loop: Dynamics, t: float, y: Array, dt: float, rate: Array) -> Array:
    """Gonzalez's discrete gradient of H in z = (q, p): second order, and exact in the energy at any step.

        z⁺ = z + h[(J − R)∇̄H + g(u + f_e)],   ∇̄H = ∇H(z_m) + (H(z⁺) − H(z) − ∇H(z_m)ᵀΔz)/|Δz|² · Δz

    with z_m the midpoint, ∇_qH = ∂V/∂q − Cᵀq̇ and ∇_pH = q̇. Then H(z⁺) − H(z) = −h∇̄HᵀR∇̄H + h∇̄Hᵀg(u + f_e) without
    error. The controller's and the bodies' states go by the midpoint rule. O. Gonzalez, "Time integration and discrete
    Hamiltonian systems", J. Nonlinear Sci. 6, 1996.
    """
    n, momentum = loop.n, loop.momentum(y)
    before = loop.energy(y[:n], momentum)

    def improved(z: Array) -> Array:
        middle = 0.5 * (start + z)
        velocity = loop.velocity(middle[:n], middle[n : 2 * n])
        middle[n : 2 * n] = velocity
        momentum_rate, state_rate = loop.momentum_rate(t + 0.5 * dt, middle)
        slope, damping = loop.energy_slope(middle)
        moved, gained = z[:n] - y[:n], z[n : 2 * n] - momentum
        after, linear = loop.energy(z[:n], z[n : 2 * n]), float(slope.dot(moved) + velocity.dot(gained))
        bend = after - before - linear
        if abs(bend) > _ROUNDING * (abs(after) + abs(before) + abs(linear)):
            bend /= float(moved.dot(moved) + gained.dot(gained))
            velocity = velocity + bend * gained
            momentum_rate = momentum_rate - bend * (moved + damping.dot(gained))
        return np.concatenate([y[:n] + dt * velocity, momentum + dt * momentum_rate, y[2 * n :] + dt * state_rate])

    start = np.concatenate([y[:n], momentum, y[2 * n :]])
    guess = y + dt * rate
    guess[n : 2 * n] = loop.momentum(guess)
    what = f"discrete gradient found no solution at t = {t:g} s: use a step below {dt:g} s"
    z = fixed_point(improved, guess, what, converged=1e-15)  # what is left is an error of the energy
    z[n : 2 * n] = loop.velocity(z[:n], z[n : 2 * n])
    return z
