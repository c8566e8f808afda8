"""Fixed-step integrators of the closed loop, in one registry.

The state is y = (q, q̇, controller state). A step is a pure function of the loop, time and state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from phcontrol._validation import Array
from phcontrol.simulation.discrete_gradient import discrete_gradient
from phcontrol.simulation.dynamics import Dynamics
from phcontrol.simulation.fixed_point import fixed_point


class Step(Protocol):
    """One step of size dt from (t, y), where ``rate`` is ẏ there."""

    def __call__(self, loop: Dynamics, t: float, y: Array, dt: float, rate: Array) -> Array:
        """Return y at t + dt."""
        ...


@dataclass(frozen=True)
class Integrator:
    """A registered integrator: its step and its order of convergence."""

    step: Step
    order: int
    stability: float
    """Largest |λ|dt of a damped mode that is stable: along the imaginary and the negative real axis."""
    summary: str


def semi_implicit_euler(loop: Dynamics, t: float, y: Array, dt: float, rate: Array) -> Array:
    """Velocity first, then position with the new velocity: first order, cheap, no energy blow-up."""
    n = loop.n
    following: Array = y + dt * rate
    following[:n] = y[:n] + dt * following[n : 2 * n]
    return following


def runge_kutta_step(rate_at: Callable[[float, Array], Array], t: float, y: Array, dt: float, rate: Array) -> Array:
    """Return y at t + dt by the classical method of Runge and Kutta: fourth order, four evaluations.

    Args:
        rate_at: ẏ(t, y), a new array each time.
        t: [s].
        y: the state at t.
        dt: [s].
        rate: ẏ at t, the first of the evaluations.
    """
    half = 0.5 * dt
    second = rate_at(t + half, y + half * rate)
    third = rate_at(t + half, y + half * second)
    fourth = rate_at(t + dt, y + dt * third)
    second += third
    second *= 2.0
    second += rate
    second += fourth
    second *= dt / 6.0
    second += y
    return second


def runge_kutta_4(loop: Dynamics, t: float, y: Array, dt: float, rate: Array) -> Array:
    """The classical method of Runge and Kutta."""
    return runge_kutta_step(loop.rate, t, y, dt, rate)


def implicit_midpoint(loop: Dynamics, t: float, y: Array, dt: float, rate: Array) -> Array:
    """The implicit midpoint rule in (q, p): second order, symplectic, so that energy does not drift.

    It solves for the midpoint.
    """
    n, half = loop.n, 0.5 * dt
    momentum = loop.momentum(y)

    def improved(middle: Array) -> Array:
        momentum_rate, state_rate = loop.momentum_rate(t + half, middle)
        position = y[:n] + half * middle[n : 2 * n]
        velocity = loop.velocity(position, momentum + half * momentum_rate)
        return np.concatenate([position, velocity, y[2 * n :] + half * state_rate])

    what = f"implicit midpoint found no solution at t = {t:g} s: use a step below {dt:g} s"
    middle = fixed_point(improved, y + half * rate, what)
    momentum_rate, state_rate = loop.momentum_rate(t + half, middle)
    position = y[:n] + dt * middle[n : 2 * n]
    velocity = loop.velocity(position, momentum + dt * momentum_rate)
    return np.concatenate([position, velocity, y[2 * n :] + dt * state_rate])


INTEGRATORS: dict[str, Integrator] = {
    "semi_implicit_euler": Integrator(semi_implicit_euler, 1, 2.0, "cheap; what most simulators do"),
    "rk4": Integrator(runge_kutta_4, 4, 2.78, "accurate; the default"),
    "implicit_midpoint": Integrator(implicit_midpoint, 2, math.inf, "symplectic; for energy studies"),
    "discrete_gradient": Integrator(discrete_gradient, 2, math.inf, "the power balance of the arm exact at any step"),
}
"""INTEGRATORS

Example:
    >>> from phcontrol import INTEGRATORS
    >>> {name: integrator.order for name, integrator in INTEGRATORS.items()}
    {'semi_implicit_euler': 1, 'rk4': 4, 'implicit_midpoint': 2, 'discrete_gradient': 2}
"""
