"""One step of each integrator on linear systems, where it is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import INTEGRATORS, PHControlError


class Oscillator:
    """m q̈ + d q̇ + k q = 0 beside ż = −z/T: what an integrator is shown of a loop."""

    n = 1

    def __init__(self, mass=1.0, damping=0.0, stiffness=1.0, time_constant=1.0):
        self.mass, self.damping, self.stiffness, self.time_constant = mass, damping, stiffness, time_constant
        self.matrix = np.array(
            [[0.0, 1.0, 0.0], [-stiffness / mass, -damping / mass, 0.0], [0.0, 0.0, -1.0 / time_constant]]
        )

    def rate(self, t, y):
        return self.matrix @ y

    def momentum_rate(self, t, y):
        return -self.stiffness * y[:1] - self.damping * y[1:2], -y[2:] / self.time_constant

    def momentum(self, y):
        return self.mass * y[1:2]

    def velocity(self, position, momentum):
        return momentum / self.mass

    def energy(self, position, momentum):
        return 0.5 * float(momentum @ momentum / self.mass + self.stiffness * position @ position)

    def energy_slope(self, y):
        return self.stiffness * y[:1], np.array([[self.damping]])


def stepped(name, loop, y, dt):
    return INTEGRATORS[name].step(loop, 0.0, y, dt, loop.rate(0.0, y))


@pytest.mark.parametrize("name", ["implicit_midpoint", "discrete_gradient"])
@given(st.floats(0.1, 10.0), st.floats(0.0, 5.0), st.floats(0.1, 50.0), st.floats(0.01, 0.5), st.floats(-3.0, 4.0))
def test_implicit_steps_are_cayleys_map_whatever_the_stiffness_and_size(name, mass, damping, stiffness, dt, size):
    """(1 − ½hA)⁻¹(1 + ½hA)y, from steps that contract to those that do not, for small and for large numbers."""
    for stiff in (1.0, 1e3):
        loop = Oscillator(mass, damping, stiff * stiffness, 0.3)
        y = 10.0**size * np.array([0.7, -0.4, 0.9])
        half, one = 0.5 * dt * loop.matrix, np.eye(3)
        expected = np.linalg.solve(one - half, (one + half) @ y)
        scale = np.abs(expected).max() + 1.0
        np.testing.assert_allclose(stepped(name, loop, y, dt), expected, atol=1e-8 * scale)


def test_a_step_without_a_solution_is_said_so():
    """v = v₀ + ½h·100(1 + v²) has none for h = 0.1."""

    class Runaway(Oscillator):
        def momentum_rate(self, t, y):
            return 100.0 * (1.0 + y[1:2] ** 2), np.zeros(1)

    message = r"no solution at t = 0 s: use a step below 0\.1 s"
    with np.errstate(all="ignore"), pytest.raises(PHControlError, match=message):  # as in a run
        stepped("implicit_midpoint", Runaway(), np.zeros(3), 0.1)
    gentle = stepped("implicit_midpoint", Runaway(), np.zeros(3), 1e-3)
    middle = (1.0 - np.sqrt(1.0 - 4.0 * 0.05**2)) / (2.0 * 0.05)  # v = 0.05(1 + v²)
    np.testing.assert_allclose(gentle, [1e-3 * middle, 2.0 * middle, 0.0], atol=1e-12)


def test_explicit_steps_are_their_polynomials():
    loop, y, h = Oscillator(2.0, 0.5, 8.0, 0.4), np.array([0.7, -0.4, 0.9]), 0.2
    z = h * loop.matrix
    taylor = np.eye(3) + z + z @ z / 2.0 + z @ z @ z / 6.0 + z @ z @ z @ z / 24.0
    np.testing.assert_allclose(stepped("rk4", loop, y, h), taylor @ y, rtol=1e-12)
    velocity = y[1] + h * (-4.0 * y[0] - 0.25 * y[1])
    expected = [y[0] + h * velocity, velocity, y[2] * (1.0 - h / 0.4)]
    np.testing.assert_allclose(stepped("semi_implicit_euler", loop, y, h), expected, rtol=1e-12)


def grows(name, damping_ratio, reach):
    """Whether steps amplify the mode of unit frequency with a damping ratio, for dt = reach."""
    loop = Oscillator(damping=2.0 * damping_ratio)
    if damping_ratio > 1.0:  # take dt for its fastest pole
        reach /= damping_ratio + np.sqrt(damping_ratio**2 - 1.0)
    columns = [stepped(name, loop, unit, reach)[:2] for unit in np.eye(3)[:2]]
    return np.abs(np.linalg.eigvals(np.array(columns))).max() > 1.0 + 1e-9


@pytest.mark.parametrize(("name", "reach"), [("semi_implicit_euler", 2.0), ("rk4", 2.78)])
def test_the_reach_of_stability_is_along_both_axes(name, reach):
    """|λ|dt of an undamped and of an overdamped mode: stable up to it, and soon after no longer in one of them."""
    assert INTEGRATORS[name].stability == reach
    assert not grows(name, 0.0, 0.999 * reach)
    if name == "rk4":
        assert not grows(name, 100.0, 0.999 * reach)
        assert grows(name, 100.0, 1.01 * reach)
    else:
        assert grows(name, 0.0, 1.01 * reach)
    for implicit in ("implicit_midpoint", "discrete_gradient"):
        assert np.isinf(INTEGRATORS[implicit].stability)
        for ratio in (0.0, 0.5, 100.0):
            assert not grows(implicit, ratio, 100.0)
