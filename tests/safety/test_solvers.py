"""The two solvers of the filter's quadratic programs against each other, and what they say wrongly."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, TorqueFilter
from phcontrol.safety.daqp_solver import DaqpSolver
from phcontrol.safety.problem import Problem
from phcontrol.safety.proxqp_solver import ProxqpSolver
from phcontrol.safety.quadratic_program import SOLVERS, QuadraticProgram, _touching
from tests.conftest import make_system
from tests.safety import random_cases


def draw(rng, kind):
    """Return a random program and a point that meets its constraints, or None where there is none."""
    n = int(rng.integers(1, 9))
    m = int(rng.integers(1, 10))
    rows = rng.normal(size=(m, n))
    if kind == "degenerate":  # rows twice, rows that are sides of the box, bounds that coincide
        rows[: m // 2] = rows[m - m // 2 :]
        rows[0] = np.eye(n)[0]
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    point = rng.uniform(-1.0, 1.0, n) if kind != "degenerate" else rng.choice([-1.0, 0.0, 1.0], n)
    values = rows @ point
    lower, upper = values - rng.uniform(0.0, 0.5, m), values + rng.uniform(0.0, 0.5, m)
    if kind == "degenerate":
        lower[rng.random(m) < 0.5] = -2.0
        upper = np.where(rng.random(m) < 0.7, values, upper)  # the point is a corner of many constraints
        lower = np.minimum(lower, upper)
    if kind == "infeasible":
        rows, lower, upper = np.vstack([rows, rows[:1]]), np.append(lower, upper[0] + 0.01), np.append(upper, 9.0)
        point = None
    root = rng.normal(size=(n, n))
    hessian = None if rng.random() < 0.5 else np.eye(n) + 10.0 ** rng.uniform(-2.0, 6.0) * root @ root.T
    gradient = 10.0 ** rng.uniform(-1.0, 3.0) * rng.normal(size=n)
    if hessian is not None:
        gradient = hessian @ rng.normal(size=n) * rng.choice([1.0, 5.0])
    return Problem(hessian, gradient, rows, lower, upper, -np.ones(n), np.ones(n)), point


def missed(problem, z, forces):
    """Return by how much z misses its constraints, stationarity and the signs of its forces; forces: rows, box."""
    m = problem.lower.size
    H = np.eye(z.size) if problem.hessian is None else problem.hessian
    values, low, high = np.append(problem.rows @ z, z), np.append(problem.lower, problem.lowest), np.append(
        problem.upper, problem.highest
    )  # fmt: skip
    outside = max(0.0, (values - high).max(), (low - values).max())
    steep = np.abs(H @ z + problem.gradient + problem.rows.T @ forces[:m] + forces[m:]).max()
    idle = np.maximum(forces, 0.0) * np.abs(high - values) + np.maximum(-forces, 0.0) * np.abs(values - low)
    return outside, (steep + idle.max()) / (1.0 + np.abs(problem.gradient).max() + np.abs(forces).max())


@pytest.mark.parametrize("kind", ["random", "degenerate"])
def test_both_solvers_find_the_same_optimum(kind):
    """Programs that have nothing to do with each other: each begins anew."""
    rng = np.random.default_rng(17)
    for _ in range(600):
        problem, point = draw(rng, kind)
        m, n = problem.rows.shape
        answers = []
        for name in SOLVERS:
            program = QuadraticProgram(n, m, name)
            z = program.solve(problem, point)
            assert z is not None
            assert (np.abs(z) <= 1.0).all()
            forces = program.multipliers
            outside, wrong = missed(problem, z, np.append(forces[:m], box_forces(problem, z, forces[:m])))
            assert outside <= 1e-9
            assert wrong <= 1e-9
            answers.append(z)
        np.testing.assert_allclose(answers[0], answers[1], atol=1e-8)


def box_forces(problem, z, forces):
    """Return what the box pushes with so that z rests: only where it touches."""
    H = np.eye(z.size) if problem.hessian is None else problem.hessian
    return np.where(np.abs(z) > 1.0 - 1e-9, -(H @ z + problem.gradient + problem.rows.T @ forces), 0.0)


def test_an_answer_is_moved_onto_what_it_touches():
    """min ½|y − (3, 2)|² with y₁ + y₂ = 2 and y₁ ≤ 1 touched: (1, 1), from a point beside both; forces by hand."""
    row = np.ones((1, 2)) / np.sqrt(2.0)
    bound = np.array([np.sqrt(2.0)])
    problem = Problem(None, np.array([-3.0, -2.0]), row, -bound - 1.0, bound, -np.ones(2), np.array([1.0, 5.0]))
    z, forces = _touching(problem, np.array([1.001, 1.002]), np.array([1.4, 1.0, 0.0]))
    np.testing.assert_allclose(z, [1.0, 1.0], atol=1e-14)
    np.testing.assert_allclose(forces, [np.sqrt(2.0), 1.0, 0.0], atol=1e-13)


def test_proxqp_starts_from_its_last_answer():
    """The same problem again takes it fewer steps; one that it did not solve is not started from."""
    rng = np.random.default_rng(22)
    cold = warm = 0
    for _ in range(20):
        problem, _ = draw(rng, "random")
        solver = ProxqpSolver(problem.gradient.size, problem.lower.size)
        answers = []
        for attempt in range(2):
            answers.append(solver.solve(problem))
            steps = solver._solver.results.info.iter
            cold, warm = (cold + steps, warm) if attempt == 0 else (cold, warm + steps)
        np.testing.assert_allclose(answers[0][0], answers[1][0], atol=1e-8)
    assert warm < 0.5 * cold


@pytest.mark.parametrize("name", SOLVERS)
def test_contradictory_bounds_have_no_answer(name):
    rng = np.random.default_rng(18)
    for _ in range(60 if name == "daqp" else 6):
        problem, _ = draw(rng, "infeasible")
        assert QuadraticProgram(problem.gradient.size, problem.lower.size, name).solve(problem) is None
        if name == "daqp":
            solver = DaqpSolver(problem.gradient.size, problem.lower.size)
            assert solver.solve(problem) is None
            assert solver.found_none


@pytest.fixture(scope="module")
def recorded():
    """Programs as the filter asks them, in the order in which it does, with the feasible points it knows."""
    asked = []
    original = QuadraticProgram.solve

    def solve(self, problem, feasible=None):
        copies = Problem(*(None if part is None else part.copy() for part in problem))
        asked.append((copies, None if feasible is None else feasible.copy()))
        return original(self, problem, feasible)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(QuadraticProgram, "solve", solve)
        random_cases.run(500, 23)
    return asked


def test_both_solvers_agree_on_the_programs_of_the_filter(recorded):
    """One program object of each size and solver, which begins with its last answer, as in the filter."""
    programs = {}
    compared = without = 0
    for problem, feasible in recorded:
        answers = []
        for name in SOLVERS:
            key = name, problem.rows.shape
            program = programs.setdefault(key, QuadraticProgram(problem.gradient.size, problem.lower.size, name))
            answers.append(program.solve(problem, feasible))
        if answers[0] is None or answers[1] is None:
            assert answers[0] is None  # what has an answer has one from both
            assert answers[1] is None
            without += 1
            continue
        compared += 1
        np.testing.assert_allclose(answers[0], answers[1], atol=2e-8)
    assert compared > 500
    assert without > 5


def nearly(problem, answer, error):
    """Return an answer as wrong as DAQP was seen: outside its bounds by ``error``."""
    z, forces = answer
    return z + error, forces


@pytest.mark.parametrize(
    "lie",
    [
        lambda problem, answer: nearly(problem, answer, 8e-7),
        lambda problem, answer: nearly(problem, answer, 0.3),
        lambda problem, answer: (answer[0], 0.0 * answer[1]),
        lambda problem, answer: (answer[0] * np.nan, answer[1]),
        lambda problem, answer: None,
    ],
    ids=["infeasible by 8e-7", "elsewhere", "no forces", "NaN", "gives up"],
)
@pytest.mark.parametrize("liar", [DaqpSolver, ProxqpSolver])
def test_what_a_solver_says_wrongly_is_found_out(monkeypatch, liar, lie):
    rng, original = np.random.default_rng(19), liar.solve
    cases = [draw(rng, "random") for _ in range(60)]
    exact = [QuadraticProgram(p.gradient.size, p.lower.size).solve(p, z) for p, z in cases]
    monkeypatch.setattr(liar, "solve", lambda self, problem: lie(problem, original(self, problem)))
    name = next(name for name, solver in SOLVERS.items() if solver is liar)
    for (problem, point), expected in zip(cases, exact, strict=True):
        found = QuadraticProgram(problem.gradient.size, problem.lower.size, name).solve(problem, point)
        np.testing.assert_allclose(found, expected, atol=1e-8)


def test_a_wrong_claim_that_there_is_no_answer_is_not_believed_where_one_is_known(monkeypatch):
    rng = np.random.default_rng(20)
    monkeypatch.setattr(DaqpSolver, "solve", lambda self, problem: None)
    monkeypatch.setattr(DaqpSolver, "found_none", True)
    for _ in range(50):
        problem, point = draw(rng, "random")
        program = QuadraticProgram(problem.gradient.size, problem.lower.size)
        assert program.solve(problem) is None
        z = program.solve(problem, point)
        assert max(missed(problem, z, np.append(
            program.multipliers[: problem.lower.size],
            box_forces(problem, z, program.multipliers[: problem.lower.size]),
        ))) <= 1e-9  # fmt: skip


def test_the_filter_gives_the_same_torques_with_either_solver():
    system = make_system("pera")
    filters = [TorqueFilter(system, period=1e-3, solver=name) for name in SOLVERS]
    rng, limits = np.random.default_rng(21), filters[0].limits
    for _ in range(200):
        x = system.at(rng.uniform(limits.lower, limits.upper), limits.velocity * rng.uniform(-1.0, 1.0, system.n))
        desired = 3.0 * limits.effort * rng.normal(size=system.n)
        found = [each.filter(x, desired) for each in filters]
        assert found[0].status == found[1].status
        np.testing.assert_allclose(found[0].torque, found[1].torque, atol=1e-7)
    assert filters[0].counts == filters[1].counts


def test_an_unknown_solver_is_refused():
    with pytest.raises(InvalidArgumentError, match="solver: must be one of 'daqp', 'proxqp', but is 'osqp'"):
        TorqueFilter(make_system("pera"), period=1e-3, solver="osqp")
