"""The right inverse of a wide matrix, plain and regularised, and its derivative."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol.mechanics.derivatives import right_inverse, right_inverse_derivative
from tests.finite_differences import derivative

shapes = st.tuples(st.integers(1, 4), st.integers(0, 4)).map(lambda pair: (pair[0], pair[0] + pair[1]))


@given(shapes, st.integers(0, 2**31))
def test_the_right_inverse_is_that_of_moore_and_penrose(shape, seed):
    B = np.random.default_rng(seed).normal(size=shape)
    inverse = right_inverse(B)
    scale = np.linalg.cond(B) ** 2
    np.testing.assert_allclose(B @ inverse, np.eye(shape[0]), atol=1e-12 * scale)
    np.testing.assert_allclose(inverse, np.linalg.pinv(B), atol=1e-12 * scale * np.abs(inverse).max())


@pytest.mark.parametrize("regularised", [False, True])
@given(shapes, st.integers(0, 2**31))
def test_its_derivative(regularised, shape, seed):
    """Against finite differences, for a stack of directions, and a regularisation that is not even symmetric."""
    rng = np.random.default_rng(seed)
    m, n = shape
    B, directions = rng.normal(size=shape), rng.normal(size=(3, m, n))
    B[:, :m] += 3.0 * np.eye(m)
    Q = 0.1 * np.eye(m) + 0.03 * rng.normal(size=(m, m)) if regularised else None
    dQ = 0.1 * rng.normal(size=(3, m, m)) if regularised else None

    def moved(h, k):
        return right_inverse(B + h * directions[k], None if Q is None else Q + h * dQ[k])

    analytic = right_inverse_derivative(B, directions, Q, dQ)
    expected = np.array([derivative(lambda h, k=k: moved(h, k), 1e-4) for k in range(3)])
    scale = np.linalg.cond(B) ** 3 * max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(analytic, expected, atol=1e-8 * scale)
    single = right_inverse_derivative(B, directions[0], Q, None if dQ is None else dQ[0])
    np.testing.assert_allclose(single, analytic[0], atol=1e-12 * scale)
