"""The kernels against their definitions, in every implementation that is here."""

import contextlib
import importlib
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.finite_differences import derivative, gradient
from tests.mechanics.layouts import LAYOUTS

IMPLEMENTATIONS = {"lapack": importlib.import_module("phcontrol.mechanics._lapack")}
with contextlib.suppress(ImportError):  # where no compiler was at hand
    IMPLEMENTATIONS["compiled"] = importlib.import_module("phcontrol.mechanics._compiled")


every_implementation = pytest.mark.parametrize("kernels", IMPLEMENTATIONS.values(), ids=IMPLEMENTATIONS)


def matrices(draw):
    """Draw a mass matrix and a Coriolis matrix of up to 20 joints."""
    size = draw(st.integers(1, 20))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    root = generator.normal(size=(size, size))
    return root @ root.T + size * np.eye(size), generator.normal(size=(size, size))


def factor_rate(mass, coriolis):
    return derivative(lambda t: np.linalg.cholesky(mass + t * (coriolis + coriolis.T)))


@every_implementation
@given(data=st.data(), layout=st.sampled_from(sorted(LAYOUTS)))
def test_factor_is_the_cholesky_factor(kernels, data, layout):
    mass, _ = matrices(data.draw)
    factor = kernels.factor(LAYOUTS[layout](mass))
    np.testing.assert_allclose(factor, np.linalg.cholesky(mass), rtol=0, atol=1e-13 * np.abs(mass).max())
    assert not np.triu(factor, 1).any()


@every_implementation
@given(data=st.data(), layout=st.sampled_from(sorted(LAYOUTS)))
def test_solves_undo_products(kernels, data, layout):
    mass, coriolis = matrices(data.draw)
    factor = np.linalg.cholesky(mass)
    for right in (coriolis[0], coriolis, coriolis[:, : (len(mass) + 1) // 2], coriolis[:, :0]):
        forward = kernels.solve(LAYOUTS[layout](factor), LAYOUTS[layout](right))
        backward = kernels.solve_transposed(LAYOUTS[layout](factor), LAYOUTS[layout](right))
        np.testing.assert_allclose(factor @ forward, right, rtol=0, atol=1e-12)
        np.testing.assert_allclose(factor.T @ backward, right, rtol=0, atol=1e-12)


@every_implementation
@given(data=st.data(), layout=st.sampled_from(sorted(LAYOUTS)))
def test_relative_factor_rate_is_that_of_a_moving_cholesky_factor(kernels, data, layout):
    mass, coriolis = matrices(data.draw)
    factor = np.linalg.cholesky(mass)
    rate = factor_rate(mass, coriolis)
    result = kernels.relative_factor_rate(LAYOUTS[layout](factor), LAYOUTS[layout](coriolis))
    np.testing.assert_allclose(factor @ result, rate, rtol=0, atol=1e-8)


@every_implementation
@given(data=st.data(), layout=st.sampled_from(sorted(LAYOUTS)))
def test_feedback_is_a_spring_and_a_damper(kernels, data, layout):
    stiffness, damping = matrices(data.draw)
    force, error, velocity, desired = (damping[i % len(damping)] + i for i in range(4))
    expected = force - stiffness @ error - damping @ (velocity - desired)
    inputs = [LAYOUTS[layout](array) for array in (force, stiffness, error, damping, velocity, desired)]
    np.testing.assert_allclose(kernels.feedback(*inputs), expected, rtol=0, atol=1e-10 * np.abs(stiffness).max())


@every_implementation
@given(data=st.data(), layout=st.sampled_from(sorted(LAYOUTS)))
def test_transformed_rate_is_its_definition(kernels, data, layout):
    mass, coriolis = matrices(data.draw)
    factor = np.linalg.cholesky(mass)
    velocity, force = coriolis[0] + 1.0, coriolis[-1] - 1.0
    rate = factor_rate(mass, coriolis)
    expected = rate.T @ velocity + np.linalg.solve(factor, force - coriolis @ velocity)
    inputs = [LAYOUTS[layout](array) for array in (factor, coriolis, velocity, force)]
    before = [array.copy() for array in inputs]
    np.testing.assert_allclose(kernels.transformed_rate(*inputs), expected, rtol=1e-7, atol=1e-7)
    for array, copy in zip(inputs, before, strict=True):
        np.testing.assert_array_equal(array, copy)  # the kernels leave their arguments as they were


@every_implementation
@given(data=st.data(), layout=st.sampled_from(sorted(LAYOUTS)))
def test_momentum_derivative_is_that_of_the_transformed_momentum(kernels, data, layout):
    mass, coriolis = matrices(data.draw)
    size = len(mass)
    generator = np.random.default_rng(size)
    slopes = generator.normal(size=(size, size, size))
    slopes = slopes + slopes.transpose(0, 2, 1)
    factor, momentum = np.linalg.cholesky(mass), coriolis[0]
    transformed = np.linalg.solve(factor, momentum)

    def at(q):
        return np.linalg.solve(np.linalg.cholesky(mass + np.tensordot(q, slopes, axes=1)), momentum)

    expected = gradient(at, np.zeros(size)).T
    result = kernels.momentum_derivative(LAYOUTS[layout](factor), LAYOUTS[layout](slopes), transformed)
    np.testing.assert_allclose(result, expected, rtol=1e-7, atol=1e-7)


@every_implementation
@pytest.mark.parametrize(
    "bad",
    [np.diag([1.0, -1.0]), np.zeros((2, 2)), np.full((2, 2), np.nan), np.diag([np.nan, 1.0]), np.diag([np.inf, 1.0])],
)
def test_a_matrix_that_is_not_positive_definite_is_refused(kernels, bad):
    with pytest.raises(ArithmeticError):
        kernels.factor(bad)


@pytest.mark.skipif("compiled" not in IMPLEMENTATIONS, reason="the kernels were not compiled")
def test_the_compiled_kernels_refuse_what_they_cannot_read():
    compiled, matrix, vector = IMPLEMENTATIONS["compiled"], np.eye(3), np.ones(3)
    for call in (
        lambda: compiled.factor(np.eye(3, dtype=np.float32)),
        lambda: compiled.factor(np.ones((3, 2))),
        lambda: compiled.factor([[1.0]]),
        lambda: compiled.factor(np.float64(1.0)),
        lambda: compiled.factor(np.eye(3).astype(">f8")),
        lambda: compiled.solve(matrix, np.ones(4)),
        lambda: compiled.solve(matrix, np.ones((4, 3))),
        lambda: compiled.solve(matrix, np.ones((3, 1, 1))),
        lambda: compiled.solve_transposed(matrix, None),
        lambda: compiled.solve(matrix, np.ones(3, dtype=int)),
        lambda: compiled.transformed_rate(matrix, matrix, vector, None),
        lambda: compiled.momentum_derivative(matrix, matrix, vector),
        lambda: compiled.feedback(vector, matrix, vector, matrix, vector, np.ones(4)),
    ):
        with pytest.raises(ValueError, match="array"):
            call()
    with pytest.raises(TypeError, match="takes 2 arguments"):
        compiled.solve(matrix)


@pytest.mark.parametrize("choice", ["lapack", "compiled", "nonsense"])
def test_the_environment_chooses_the_kernels(choice):
    command = [sys.executable, "-c", "from phcontrol.mechanics.kernels import KERNELS; print(KERNELS)"]
    result = subprocess.run(command, env=os.environ | {"PHCONTROL_KERNELS": choice}, capture_output=True, text=True)
    if choice in IMPLEMENTATIONS:
        assert (result.returncode, result.stdout.strip()) == (0, choice)
    else:
        assert result.returncode != 0
        assert "PHCONTROL_KERNELS" in result.stderr


@pytest.mark.parametrize("choice", ["", "compiled"])
def test_kernels_that_were_not_built_are_done_without_unless_they_are_asked_for(choice):
    program = "import sys; sys.modules['phcontrol.mechanics._compiled'] = None\n"
    program += "from phcontrol.mechanics.kernels import KERNELS; print(KERNELS)"
    command = [sys.executable, "-c", program]
    result = subprocess.run(command, env=os.environ | {"PHCONTROL_KERNELS": choice}, capture_output=True, text=True)
    if choice:
        assert result.returncode != 0
        assert "PHCONTROL_KERNELS is 'compiled', but the kernels were not built" in result.stderr
    else:
        assert (result.returncode, result.stdout.strip()) == (0, "lapack"), result.stderr


@every_implementation
@pytest.mark.parametrize("make", LAYOUTS.values(), ids=LAYOUTS)
def test_a_plain_finite_vector_is_copied(kernels, make):
    value = make(np.array([1.0, -0.0, 1e300]))
    copy = kernels.finite_copy(value, 3)
    np.testing.assert_array_equal(copy, value)
    assert not np.shares_memory(copy, value)
    assert copy.flags.writeable
    assert copy.dtype == np.float64


@every_implementation
@pytest.mark.parametrize(
    "value",
    [
        [1.0, 2.0, 3.0],
        np.ones(2),
        np.ones((3, 1)),
        np.ones(3, dtype=np.float32),
        np.ones(3, dtype=int),
        np.ones(3, dtype=">f8"),
        np.ones(3, dtype=complex),
        np.array([1.0, np.nan, 2.0]),
        np.array([1.0, np.inf, 2.0]),
        np.array([-np.inf, np.inf, 2.0]),
        np.ma.masked_array(np.ones(3)),
        np.frombuffer(b"\0" * 25, dtype=np.uint8)[1:25].view(np.float64),
        None,
        "abc",
    ],
    ids=repr,
)
def test_anything_else_is_not_copied(kernels, value):
    assert kernels.finite_copy(value, 3) is None
