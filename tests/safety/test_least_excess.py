"""The least excess over bounds, against what can be found by hand and a general solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from phcontrol.safety.least_excess import LeastExcess


def test_bounds_that_can_be_kept_are_kept_near_the_preferred_point():
    z = LeastExcess(2).solve(np.eye(2), np.array([-1.0, 0.5]), np.array([0.3, 1.0]), np.ones(2), np.array([0.8, -0.8]))
    np.testing.assert_allclose(z, [0.3, 0.5], atol=3e-4)  # the weights are as 1 : 10⁴
    inside = np.array([0.1, 0.7])
    z = LeastExcess(2).solve(np.eye(2), np.array([-1.0, 0.5]), np.array([0.3, 1.0]), np.ones(2), inside)
    np.testing.assert_allclose(z, inside, atol=1e-12)


def test_bounds_out_of_reach_are_approached():
    z = LeastExcess(1).solve(np.ones((1, 1)), np.array([1e6]), np.array([1e7]), np.ones(1), np.zeros(1))
    assert z == pytest.approx(1.0)
    rows = np.array([[1.0, 0.0], [0.0, 1.0]])  # the first bound is 1 beyond reach, the second at its edge
    z = LeastExcess(2).solve(rows, np.array([2.0, -5.0]), np.array([3.0, -1.0]), np.ones(2), np.zeros(2))
    np.testing.assert_allclose(z, [1.0, -1.0], atol=2e-4)


@pytest.mark.parametrize("seed", range(20))
def test_random_bounds_against_a_general_solver(seed):
    rng, n = np.random.default_rng(seed), 4
    rows = rng.normal(size=(n, n))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    lower = rng.normal(size=n)
    upper, preferred = lower + rng.uniform(0.0, 1.0, n), rng.uniform(-1.0, 1.0, n)
    extent = np.abs(rows).sum(axis=1) + 1.0
    low, high = np.minimum(lower, extent), np.maximum(upper, -extent)

    def cost(z):
        excess = rows @ z - np.clip(rows @ z, low, high)
        return 0.5 * 1e4 * excess @ excess + 0.5 * (z - preferred) @ (z - preferred)

    def slope(z):
        return 1e4 * rows.T @ (rows @ z - np.clip(rows @ z, low, high)) + z - preferred

    z = LeastExcess(n).solve(rows, lower, upper, np.ones(n), preferred)
    assert (np.abs(z) <= 1.0).all()
    found = minimize(cost, z, jac=slope, bounds=[(-1.0, 1.0)] * n, method="L-BFGS-B", options={"ftol": 1e-15})
    assert cost(z) <= found.fun * (1.0 + 1e-9)
    np.testing.assert_allclose(np.clip(z - slope(z), -1.0, 1.0), z, atol=1e-7)  # no way down
