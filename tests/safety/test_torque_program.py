"""The torque filter's program against solutions found by hand, on each of the ways to them."""

from __future__ import annotations

import daqp
import numpy as np
import pytest

from phcontrol import FilterStatus
from phcontrol.safety.problem import Problem
from phcontrol.safety.quadratic_constraint import QuadraticConstraint
from phcontrol.safety.quadratic_program import QuadraticProgram
from phcontrol.safety.torque_program import TorqueProgram


@pytest.fixture
def program():
    """Two unknowns, |z| ≤ 10, rows |z_i| ≤ 5."""
    program = TorqueProgram(2)
    program.rows[:2], program.lower[:2], program.upper[:2] = np.eye(2), -5.0, 5.0
    return program


def solve(program, target, constraint=None, hessian=None, feasible=(0.0, 0.0)):
    """Return status and answer for the point nearest to a target."""
    target = np.asarray(target, dtype=float)
    gradient, extent = (-target if hessian is None else -hessian @ target), np.full(2, 10.0)
    free = Problem(hessian, gradient, program.rows[:2], program.lower[:2], program.upper[:2], -extent, extent)
    return program.solve(free, np.asarray(feasible), constraint)


def disc(radius, centre=(0.0, 0.0), around=(3.0, -1.0)):
    """½|z − centre|² ≤ ½ radius², written around another point."""
    way = np.asarray(around) - np.asarray(centre)
    return QuadraticConstraint(np.asarray(around), 0.5 * (way @ way - radius**2), way, np.eye(2))


def test_value_and_tangent_of_a_disc():
    constraint = disc(1.0)
    for z in np.random.default_rng(0).normal(size=(20, 2)):
        assert constraint.value(z) == pytest.approx(0.5 * (z @ z - 1.0))
        row, bound, length = constraint.tangent(z)
        np.testing.assert_allclose(row, z / np.linalg.norm(z))
        assert length == pytest.approx(np.linalg.norm(z))
        assert bound == pytest.approx((0.5 * z @ z + 0.5) / np.linalg.norm(z))  # where the tangent plane is 0


@pytest.mark.parametrize("repeats", [1, 3])
def test_the_nearest_point_of_a_disc(program, repeats):
    for _ in range(repeats):  # cold, then started from the last answer
        status, z = solve(program, [3.0, 4.0], disc(1.0))
        assert status == FilterStatus.SOLVED
        np.testing.assert_allclose(z, [0.6, 0.8], atol=1e-9)
        assert program.is_constrained
    status, z = solve(program, [0.3, 0.4], disc(1.0))
    assert status == FilterStatus.SOLVED
    np.testing.assert_allclose(z, [0.3, 0.4], atol=1e-9)
    assert not program.is_constrained


def test_the_nearest_point_in_another_metric(program):
    """min ½(4(z₁ − 3)² + z₂²)/1 on the unit disc around (0, 1): stationary, 4(z₁ − 3) + μz₁ = 0, z₂ + μ(z₂ − 1) = 0."""
    status, z = solve(program, [3.0, 0.0], disc(1.0, centre=(0.0, 1.0)), np.diag([4.0, 1.0]))
    assert status == FilterStatus.SOLVED
    weight = 4.0 * (3.0 - z[0]) / z[0]
    assert weight > 0.0
    assert z[1] * (1.0 + weight) == pytest.approx(weight, rel=1e-8)
    assert z[0] ** 2 + (z[1] - 1.0) ** 2 == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("radius", [2.0, 4.0])
def test_the_weight_of_the_constraint_is_the_force_on_the_disc(program, radius):
    """Stationary: z − (3, 4) + μz = 0 with |z| = r, so that 5 = (1 + μ)r; a second start from that needs no search."""
    for _ in range(2):
        status, z = solve(program, [3.0, 4.0], disc(radius))
        assert status == FilterStatus.SOLVED
        np.testing.assert_allclose(z, [0.6 * radius, 0.8 * radius], atol=1e-9)
        assert program._weight == pytest.approx(5.0 / radius - 1.0, rel=1e-6)


@pytest.mark.parametrize("repeats", [1, 3])
def test_a_disc_out_of_reach_is_relaxed_at_its_nearest_point(program, repeats):
    program.upper[0] = 0.5  # the disc begins at z₁ = 1
    for _ in range(repeats):
        status, z = solve(program, [0.0, 2.0], disc(1.0, centre=(2.0, 0.0)))
        assert status == FilterStatus.STORAGE_RELAXED
        np.testing.assert_allclose(z, [0.5, 0.0], atol=1e-5)
    status, z = solve(program, [0.0, 2.0], disc(1.0, centre=(1.0, 0.0)))  # now it is in reach
    assert status == FilterStatus.SOLVED
    np.testing.assert_allclose(z, [0.5, np.sqrt(0.75)], atol=1e-8)  # the corner of disc and bound


def test_where_the_tangents_fail_a_search_finds_the_same(program, monkeypatch):
    monkeypatch.setattr(TorqueProgram, "_by_tangents", lambda self, free, constraint, feasible=None: None)
    status, z = solve(program, [3.0, 4.0], disc(1.0))
    assert status == FilterStatus.SOLVED
    np.testing.assert_allclose(z, [0.6, 0.8], atol=1e-8)
    monkeypatch.setattr(program._free, "solve", lambda problem, feasible=None: None)
    assert solve(program, [3.0, 4.0], disc(1.0)) == (FilterStatus.FALLBACK, None)
    assert solve(program, [3.0, 4.0]) == (FilterStatus.FALLBACK, None)


def test_a_feasible_point_is_said_to_be_no_more_than_that(program, monkeypatch):
    """The search cannot go on: the answer meets the constraint, and is not called the nearest."""
    monkeypatch.setattr(TorqueProgram, "_by_tangents", lambda self, free, constraint, feasible=None: None)
    original, calls = program._free.solve, []

    def failing(problem, feasible=None):
        calls.append(problem)
        return original(problem, feasible) if len(calls) <= 1 else None

    monkeypatch.setattr(program._free, "solve", failing)
    status, z = solve(program, [3.0, 4.0], disc(1.0))
    assert status == FilterStatus.FEASIBLE
    assert np.linalg.norm(z) <= 1.0 + 1e-9


def test_where_the_solver_fails_the_way_from_a_feasible_point_finds_the_optimum(program, monkeypatch):
    monkeypatch.setattr(QuadraticProgram, "_attempt", lambda self, solver, problem: None)
    status, z = solve(program, [3.0, 4.0], disc(1.0))
    assert status == FilterStatus.SOLVED
    np.testing.assert_allclose(z, [0.6, 0.8], atol=1e-9)
    program.reset()
    program.upper[1] = 0.25
    status, z = solve(program, [3.0, 4.0])
    assert status == FilterStatus.SOLVED
    np.testing.assert_allclose(z, [3.0, 0.25], atol=1e-12)


@pytest.mark.parametrize("seed", range(30))
def test_the_way_from_a_feasible_point_ends_where_another_solver_does(seed, monkeypatch):
    rng, n = np.random.default_rng(seed), 6
    root, rows = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    feasible = rng.uniform(-1.0, 1.0, n)
    lower, upper = rows @ feasible - rng.uniform(0.0, 0.3, n), rows @ feasible + rng.uniform(0.0, 0.3, n)
    hessian, gradient, extent = np.eye(n) + root @ root.T, 20.0 * rng.normal(size=n), np.ones(n)
    problem = Problem(hessian, gradient, rows, lower, upper, -extent, extent)
    monkeypatch.setattr(QuadraticProgram, "_attempt", lambda self, solver, problem: None)
    z = QuadraticProgram(n, n).solve(problem, feasible)
    bounds = np.concatenate([extent, upper]), np.concatenate([-extent, lower])
    reference, _, flag, _ = daqp.solve(hessian, gradient, rows, *bounds, np.zeros(2 * n, dtype=np.int32))
    assert flag == 1
    np.testing.assert_allclose(z, reference, atol=1e-6)
