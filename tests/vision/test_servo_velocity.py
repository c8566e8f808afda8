"""The velocity by which the servo law steers: its definition by singular values, and differences of it."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol.mechanics.singular_damping import SingularDamping
from phcontrol.vision.servo_velocity import ServoVelocity
from tests.finite_differences import derivative

LEVEL, REGION = 0.3, 0.5
WEIGHT = np.diag([1.0, 1.0, 4.0])
RATE = np.diag([1.0, 2.0, 3.0])
LAW = ServoVelocity(RATE, SingularDamping(LEVEL, REGION, WEIGHT))
HALF = np.sqrt(WEIGHT)
SMALLEST = {"regular": 0.9, "nearly singular": 0.3, "more nearly singular": 0.05}


def with_values(smallest, seed):
    """An image Jacobian of four joints whose singular values, weighed, are 2, 1 and the smallest."""
    left, right = (np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))[0] for n in (3, 4))
    return HALF @ left @ np.diag([2.0, 1.0, smallest]) @ right[:3]


def by_definition(B, error, pull):
    """Return s = Bᵀ(BBᵀ + λ²W)⁻¹Λτ̄ + (1 − λ²/λ₀²)(1 − B†B)z."""
    smallest = np.linalg.svd(np.linalg.solve(HALF, B), compute_uv=False)[-1]
    share = max(0.0, 1.0 - (smallest / REGION) ** 2) ** 2
    s = B.T @ np.linalg.inv(B @ B.T + LEVEL**2 * share * WEIGHT) @ RATE @ error
    if pull is not None:
        s = s + (1.0 - share) * (pull - np.linalg.pinv(B) @ B @ pull)
    return s


@pytest.mark.parametrize("pulled", [True, False])
@pytest.mark.parametrize("smallest", SMALLEST.values(), ids=list(SMALLEST))
def test_it_is_what_it_is_said_to_be_and_its_rates_are_the_derivatives(smallest, pulled, rng):
    B, B_rate = with_values(smallest, 3), 0.1 * rng.normal(size=(3, 4))
    error, error_rate = rng.normal(size=(2, 3))
    pull, pull_rate = rng.normal(size=(2, 4)) if pulled else (None, None)
    expected = by_definition(B, error, pull)

    def later(h):
        return by_definition(B + h * B_rate, error + h * error_rate, pull + h * pull_rate if pulled else None)

    rate = derivative(later, 1e-4)
    s, s_rate = LAW.along(B, B_rate, error, error_rate, pull, pull_rate)
    column, columns = LAW.derivatives(
        B, np.stack([B_rate, 2.0 * B_rate]), error, np.stack([error_rate, 2.0 * error_rate]), pull,
        np.stack([pull_rate, 2.0 * pull_rate]) if pulled else None,
    )  # fmt: skip
    for value in (LAW.value(B, error, pull), s, column):
        np.testing.assert_allclose(value, expected, rtol=1e-11, atol=1e-12)
    for value in (s_rate, columns[0], 0.5 * columns[1]):
        np.testing.assert_allclose(value, rate, atol=1e-7 * np.abs(rate).max())


def test_at_a_singularity_it_does_not_pull(rng):
    B, error, pull = with_values(0.0, 4), rng.normal(size=3), rng.normal(size=4)
    expected = B.T @ np.linalg.inv(B @ B.T + LEVEL**2 * WEIGHT) @ RATE @ error
    np.testing.assert_allclose(LAW.value(B, error, pull), expected, atol=1e-12)
    np.testing.assert_allclose(LAW.along(B, 0.0 * B, error, error, pull, pull)[0], expected, atol=1e-12)
