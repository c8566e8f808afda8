"""The damping near singular sets: the formula, and its slope by finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.linalg import sqrtm

from phcontrol.mechanics.singular_damping import SingularDamping
from tests.finite_differences import derivative


@pytest.mark.parametrize("rows", [3, 6])
@example(seed=0, size=1.5, nearness=0.1)  # large numbers: lengths in millimetres
@example(seed=1, size=1.5, nearness=0.1)
@example(seed=2, size=-1.5, nearness=0.1)
@given(seed=st.integers(0, 2**31), size=st.floats(-2.0, 2.0), nearness=st.floats(-1.0, 1.0))
def test_damping_near_singularities_is_the_formula_and_its_slope_the_derivative(rows, seed, size, nearness):
    """λ² = λ₀²(1 − Π(1 − dᵢ²)), dᵢ = 1 − (σᵢ/ε)² with the singular values of W^(−½)B, for matrices of any size."""
    rng = np.random.default_rng(seed)
    B = 10.0**size * rng.normal(size=(rows, rows + 3))
    half = rng.normal(size=(rows, rows))
    skew = rng.normal(size=(rows, rows))
    weight = half @ half.T + 0.3 * np.eye(rows) + 0.1 * (skew - skew.T)
    root = np.linalg.inv(np.real(sqrtm(0.5 * (weight + weight.T))))

    def smallest(square):
        return np.sqrt(np.linalg.eigvalsh(root @ square @ root)[0])

    sigma = smallest(B @ B.T)
    region, level = sigma * 10.0**nearness, 0.3
    damping = SingularDamping(level, region, weight)
    found = damping.at(B @ B.T)
    if sigma >= region * (1.0 + 1e-9):
        assert found is None
        assert damping.distance(B @ B.T) == pytest.approx(float(sigma), rel=1e-6)
        return
    if sigma >= region * (1.0 - 1e-6):
        return
    assert found is not None
    squared, slope = found

    def law(square):
        depths = np.clip(1.0 - np.linalg.eigvalsh(root @ square @ root) / region**2, 0.0, None)
        return np.array(level**2 * (1.0 - np.prod(1.0 - depths**2)))

    assert squared == pytest.approx(float(law(B @ B.T)), rel=1e-6, abs=1e-9 * level**2)
    direction = rng.normal(size=(rows, rows))
    direction = direction + direction.T
    direction *= region**2 / np.linalg.norm(direction)
    step = 1e-4 * min(1.0, sigma**2 / region**2)
    moved = derivative(lambda h: law(B @ B.T + h * direction), step)
    assert np.trace(slope @ direction) == pytest.approx(float(moved), rel=1e-3, abs=1e-5 * level**2)
    assert damping.distance(B @ B.T) == pytest.approx(float(sigma), rel=1e-6)
    assert SingularDamping(0.0, region, weight).at(B @ B.T) is None


@pytest.mark.parametrize("size", [0.3, 0.7, 0.97])
def test_the_damping_is_smooth_where_two_singular_values_cross(size):
    """On a line through equal singular values λ² has the same slope on both sides, which that of the smallest has not.

    Seen in a composition on the three joints of the PERA: H_d had no gradient there.
    """
    region, level = 0.02, 0.012
    damping = SingularDamping(level, region, np.eye(3))
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))

    def at(share):
        return damping.at(turn @ np.diag([(size * region) ** 2 + share, (size * region) ** 2 - share, 1.0]) @ turn.T)

    def slope(share):
        return float(np.vdot(at(share)[1], turn @ np.diag([1.0, -1.0, 0.0]) @ turn.T))

    small = 1e-6 * region**2
    ahead, behind = ((at(sign * small)[0] - at(0.0)[0]) / (sign * small) for sign in (1.0, -1.0))
    unit = level**2 / region**2
    assert ahead == pytest.approx(behind, abs=1e-4 * unit)
    assert slope(0.0) == pytest.approx(0.0, abs=1e-9 * unit)
    moved = derivative(lambda h: np.array(at(0.02 * region**2 + h)[0]), 1e-4 * region**2)
    assert slope(0.02 * region**2) == pytest.approx(float(moved), abs=1e-6 * unit)
