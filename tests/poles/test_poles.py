"""Poles beside the polynomials they must have, found another way: by brute force, by scales, by SciPy's optimiser."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh
from scipy.optimize import brentq, minimize

from phcontrol.poles.diagonal_directions import DiagonalDirections
from phcontrol.poles.directions import Directions
from phcontrol.poles.force_feedback_poles import ForceFeedbackPoles
from phcontrol.poles.integral_action_poles import IntegralActionPoles
from phcontrol.poles.placed_matrices import placed_matrices
from phcontrol.poles.second_order_poles import SecondOrderPoles
from tests.potentials.cases import random_gain

KINDS = [SecondOrderPoles, ForceFeedbackPoles, IntegralActionPoles]
POWERS = {  # of 1/s in the gains of one direction
    "stiffness": 2, "damping": 1, "force_gain": 0, "integral_gain": 1, "integral_stiffness": 2,
}  # fmt: skip
RATIOS = [0.3, 0.7, 1.0, 1.8]


def integral_matrix(g, d):
    """The loop of one direction under integral action, from the law's equations."""
    k, c, s, i, kappa = (
        g[name] for name in ("stiffness", "damping", "force_gain", "integral_gain", "integral_stiffness")
    )
    return np.array([[-i, 1, 1, 0], [-k, -d - c, -d, -1], [-s * k, -s * d, -s * d, 0], [0, kappa, 0, 0]])


@pytest.mark.parametrize("ratio", [0.5, 0.9, 1.0, 1.3, 1.8, 3.0])
@pytest.mark.parametrize("friction", [1.0, 15.0, 40.0, 300.0])
def test_against_friction_the_slower_pole_is_where_it_is_desired(ratio, friction):
    omega = 5.0
    desired = np.roots([1.0, 2.0 * ratio * omega, omega**2])
    placed = SecondOrderPoles(omega, ratio).place(friction)
    if friction <= 0.9 * 2.0 * ratio * omega:
        assert placed.exact
        np.testing.assert_allclose(np.sort_complex(placed.poles), np.sort_complex(desired), rtol=1e-7)
        return
    assert not placed.exact
    assert placed.gains["damping"] == pytest.approx(0.1 * 2.0 * ratio * omega)  # a tenth is injected at least
    total = friction + placed.gains["damping"]
    np.testing.assert_allclose(np.sort(placed.poles), np.sort(np.roots([1.0, total, placed.gains["stiffness"]])))
    slowest = np.abs(desired).min()  # at ω where the desired pair oscillates
    if total > 2.0 * slowest:
        assert np.abs(placed.poles).min() == pytest.approx(slowest, rel=1e-9)
        assert np.abs(placed.poles.imag).max() == 0.0
    else:
        assert placed.gains["stiffness"] == omega**2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("friction", [0.0, 0.3, 4.0, 60.0])
def test_gains_have_the_units_they_are_said_to_have(kind, ratio, friction):
    """The same loop, told in milliseconds or in hours: each gain scales with its power of 1/s, each pole too."""
    placed = kind(5.0, ratio, 1.5).place(friction)
    for scale in (1e-3, 1.0 / 3600.0, 1e3):
        scaled = kind(scale * 5.0, ratio, 1.5).place(scale * friction)
        assert scaled.exact == placed.exact
        np.testing.assert_allclose(
            np.sort_complex(scaled.poles), scale * np.sort_complex(placed.poles), rtol=1e-6, atol=1e-7 * scale
        )
        for name, value in placed.gains.items():
            assert scaled.gains[name] == pytest.approx(scale ** POWERS[name] * value, rel=1e-6), name


@pytest.mark.parametrize(("ratio", "further"), [(0.2, 1.0), (0.7, 0.5), (1.0, 1.0), (1.8, 4.0)])
def test_force_feedback_takes_the_least_gain_that_there_is(ratio, further):
    """Against a search along s for loops with the middle coefficient; c and k follow from the other two."""
    omega = 5.0
    for friction in (0.05, 1.0, 3.0, 6.0, 9.0, 12.0, 20.0, 35.0, 60.0, 150.0):
        placed = ForceFeedbackPoles(omega, ratio, further).place(friction)
        g = placed.gains
        assert min(g.values()) > 0.0
        _, a2, a1, a0 = np.poly(placed.poles).real

        def loops(s, a2=a2, a0=a0, d=friction):
            c = a2 - (1.0 + s) * d
            k, one, none = a0 / (c * s), np.ones_like(s), np.zeros_like(s)
            rows = [[none, one, one], [-k, -d - c, -d * one], [-s * k, -s * d, -s * d]]
            return np.moveaxis(np.array(rows), -1, 0)

        def off(s, a1=a1, loops=loops):  # the sum of the principal minors of second order is (tr(A)² − tr(A²))/2
            A = loops(np.atleast_1d(s))
            trace, square = np.trace(A, axis1=1, axis2=2), np.trace(A @ A, axis1=1, axis2=2)
            return 0.5 * (trace**2 - square) - a1

        most = a2 / friction - 1.0  # where c is 0
        grid = most * np.geomspace(1e-7, 1.0 - 1e-9, 4000)
        values = off(grid)
        crossings = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
        assert crossings.size
        least = brentq(lambda s, off=off: float(off(s)[0]), grid[crossings[0]], grid[crossings[0] + 1], xtol=1e-13)
        assert g["force_gain"] == pytest.approx(least, rel=1e-5)
        k, c, s, d = g["stiffness"], g["damping"], g["force_gain"], friction
        loop = np.array([[0.0, 1.0, 1.0], [-k, -d - c, -d], [-s * k, -s * d, -s * d]])
        np.testing.assert_allclose(np.poly(loop), np.poly(placed.poles).real, rtol=1e-7)
        real = -placed.poles.real[np.abs(placed.poles.imag) < 1e-3]
        ways = np.log(np.abs(real / (further * omega))) / math.log(1.25)  # moved on by whole steps
        assert np.abs(ways - np.round(ways)).min() < 1e-4  # of a triple root only a third of the digits are known
        if friction < 1.0:
            assert np.abs(real - further * omega).min() < 1e-4 * omega  # and not moved at all where it need not be


@pytest.mark.parametrize("ratio", [0.3, 0.7, 1.0])
@pytest.mark.parametrize("friction", [0.0, 0.3, 4.0])
def test_integral_action_takes_the_gains_nearest_to_the_usual(ratio, friction):
    """Against a minimisation by SciPy over all five gains, with the polynomial as a constraint; to its 400 steps."""
    omega = 5.0
    placed = IntegralActionPoles(omega, ratio).place(friction)
    polynomial = np.poly(placed.poles).real
    desired = np.polymul(np.polymul([1.0, 2.0 * ratio * omega, omega**2], [1.0, omega]), [1.0, 2.0 * omega])
    names = list(placed.gains)
    usual = {"integral_gain": 0.5 * omega, "damping": 2.0 * ratio * omega, "stiffness": omega**2, "force_gain": 0.3}

    def distance(logs):
        gains = dict(zip(names, np.exp(logs), strict=True))
        return sum(math.log(gains[name] / value) ** 2 for name, value in usual.items())

    def missed(logs):
        return (
            np.poly(integral_matrix(dict(zip(names, np.exp(logs), strict=True)), friction))[1:] / polynomial[1:] - 1.0
        )

    np.testing.assert_allclose(polynomial, desired, rtol=1e-7)
    found = np.log([placed.gains[name] for name in names])
    assert np.abs(missed(found)).max() < 1e-8
    rng, least = np.random.default_rng(0), math.inf
    for _ in range(8):
        start = found + rng.uniform(-0.7, 0.7, size=5)
        constraint = {"type": "eq", "fun": missed}
        result = minimize(distance, start, method="SLSQP", constraints=[constraint], options={"maxiter": 500})
        if result.success and np.abs(missed(result.x)).max() < 1e-6:
            least = min(least, float(result.fun))
    assert math.isfinite(least)
    assert distance(found) <= least + 0.01 * max(least, 0.1)


def test_gains_of_all_joints_are_those_of_their_directions(rng):
    """The loop of all joints, as one matrix, has the poles of every direction."""
    M, D = random_gain(rng, 4, 3.0), random_gain(rng, 4, 2.0)
    for diagonal in (False, True):
        inertia, friction = (np.diag(np.diag(M)), np.diag(np.diag(D))) if diagonal else (M, D)
        found = placed_matrices(SecondOrderPoles(5.0, 0.7), inertia, friction, diagonal=diagonal)
        K, C = found.gains["stiffness"], found.gains["damping"]
        loop = np.block(
            [[np.zeros((4, 4)), np.eye(4)], [-np.linalg.solve(inertia, K), -np.linalg.solve(inertia, friction + C)]]
        )
        poles = np.concatenate([each.poles for each in found.found])
        np.testing.assert_allclose(np.poly(loop), np.poly(poles).real, rtol=1e-7)
        damped = eigh(friction, inertia, eigvals_only=True)
        np.testing.assert_allclose(np.sort(found.friction), damped, rtol=1e-9)


def test_directions_are_those_of_the_pair(rng):
    """Functions f(d) of the pair (D, M) as they are defined: M f(M⁻¹D) for forces, f(D̄) for ratios."""
    M, D = random_gain(rng, 4, 3.0), random_gain(rng, 4, 2.0)
    directions, T = Directions(M, D), np.linalg.cholesky(M)
    np.testing.assert_allclose(directions.friction, eigh(D, M, eigvals_only=True), rtol=1e-10)
    numbers = 1.0 + directions.friction**2
    bar = np.linalg.solve(T, np.linalg.solve(T, D).T)
    expected = np.eye(4) + bar @ bar
    np.testing.assert_allclose(directions.matrix("ratio", numbers), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(directions.matrix("force", numbers), T @ expected @ T.T, rtol=1e-9, atol=1e-12)
    turned = np.linalg.solve(T.T, expected @ T.T)
    np.testing.assert_allclose(directions.matrix("rate", numbers), turned, rtol=1e-9, atol=1e-12)
    without = Directions(M, np.zeros((4, 4)))
    np.testing.assert_array_equal(without.friction, np.zeros(4))
    np.testing.assert_allclose(without.matrix("force", np.full(4, 7.0)), 7.0 * M, rtol=1e-12)
    np.testing.assert_allclose(without.matrix("rate", np.full(4, 7.0)), 7.0 * np.eye(4), atol=1e-12)


def test_diagonal_directions_leave_no_mode_slower(rng):
    """K = f diag(M)/r, the least eigenvalue of the pair (K, M) is f."""
    M = random_gain(rng, 4, 3.0)
    directions = DiagonalDirections(M, np.diag([1.0, 2.0, 3.0, 4.0]))
    K = directions.matrix("force", np.full(4, 7.0))
    assert np.count_nonzero(K - np.diag(K.diagonal())) == 0
    assert eigh(K, M, eigvals_only=True)[0] == pytest.approx(7.0)
    np.testing.assert_allclose(K.diagonal() / M.diagonal(), K[0, 0] / M[0, 0])
    numbers = np.array([1.0, 2.0, 3.0, 4.0])
    for kind in ("rate", "ratio"):
        np.testing.assert_array_equal(directions.matrix(kind, numbers), np.diag(numbers))
    np.testing.assert_allclose(directions.friction, numbers * 7.0 / K.diagonal())
    blocks = block_diag([[2.0]], [[5.0]])  # joints that do not move each other: directions are the joints
    np.testing.assert_allclose(DiagonalDirections(blocks, blocks).friction, 1.0)


def test_an_input_matrix_turns_the_damping(rng):
    M, G = random_gain(rng, 3, 2.0), np.eye(3) + 0.3 * rng.normal(size=(3, 3))
    plain = placed_matrices(ForceFeedbackPoles(5.0, 0.7), M, np.zeros((3, 3)))
    turned = placed_matrices(ForceFeedbackPoles(5.0, 0.7), M, np.zeros((3, 3)), G)
    np.testing.assert_allclose(G @ turned.gains["damping"] @ G.T, plain.gains["damping"], rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(turned.gains["stiffness"], plain.gains["stiffness"])
    assert plain.gains["coupling"] == 1.0
    assert "coupling" not in placed_matrices(SecondOrderPoles(5.0, 0.7), M, np.zeros((3, 3))).gains
