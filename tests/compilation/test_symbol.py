"""The symbolic scalar computes what floats do, and notes which way branches went."""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest

from phcontrol.compilation.arithmetic import BUILT_IN, STAND_INS
from phcontrol.compilation.c_code import literal
from phcontrol.compilation.errors import NotTraceableError
from phcontrol.compilation.linear_algebra import eliminate, factor, solve, solve_square, solve_transposed
from phcontrol.compilation.symbol import Guards, Symbol, SymbolArray, symbols
from phcontrol.compilation.tracing import tracing

np_, math_ = STAND_INS[0][1], STAND_INS[1][1]


class World:
    """Symbols with samples, and the value of what is made of them at the sample and elsewhere."""

    def __init__(self, *samples):
        self.guards = Guards()
        self.inputs = casadi.SX.sym("x", len(samples))
        self.samples = samples
        self.symbols = [
            Symbol(entry, value, self.guards)
            for entry, value in zip(casadi.vertsplit(self.inputs), samples, strict=True)
        ]

    def at(self, results, values=None):
        entries = [entry.expression if isinstance(entry, Symbol) else entry for entry in np.ravel(results)]
        function = casadi.Function("f", [self.inputs], [casadi.vertcat(*entries)])
        return np.array(function(self.samples if values is None else values)).ravel()

    def guards_at(self, values):
        return bool(self.at(self.guards.expressions, values).all())


FORMULAS = {
    "sums": lambda x, y, m: x + y - 2.0 * x - (3.0 - y) + (-y),
    "products": lambda x, y, m: x * y * 2.0 / (1.0 + y * y) + 1.0 / x - x / 4.0,
    "powers": lambda x, y, m: x**2 + x**3 + x**-2 + x**0.5 + x**y + 2.0**y,
    "remainder": lambda x, y, m: (x - 9.0) % 2.0 + y % 1.5,
    "functions": lambda x, y, m: m.sin(x) + m.cos(y) * m.tan(0.1 * x) + m.exp(-y) + m.log(x) + m.sqrt(x),
    "more": lambda x, y, m: m.atan(x) + m.asin(0.1 * x) - m.acos(0.2 * y) + m.atan2(x, y) + m.hypot(x, y) + m.tanh(x),
    "fmod": lambda x, y, m: m.fmod(-3.0 * x, y) + m.floor(x),
    "absolute": lambda x, y, m: abs(x - 10.0) + abs(y),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_a_formula_has_the_value_that_floats_give(name):
    formula = FORMULAS[name]
    world = World(1.7, 0.6)
    result = formula(*world.symbols, math_)
    for values in ((1.7, 0.6), (2.3, 1.1), (0.4, 0.9)):
        assert world.at([result], values)[0] == pytest.approx(formula(*values, math), rel=1e-14)
    assert result.sample == pytest.approx(formula(1.7, 0.6, math), rel=1e-14)
    assert world.guards.expressions == []


def test_numbers_in_c_are_read_as_the_same():
    assert (literal(math.inf, False), literal(-math.inf, False), literal(math.nan, False)) == (
        "INFINITY", "(-INFINITY)", "NAN",
    )  # fmt: skip
    for value in (1.0, -2.5e-17, 1e300, 0.1):
        assert float(literal(value, False).strip("()")) == value


def test_a_remainder_has_the_sign_of_its_divisor():
    world = World(1.7, 0.6)
    x, y = world.symbols
    for values in ((1.7, 0.6), (-1.7, 0.6), (1.7, -0.6), (-1.7, -0.6)):
        assert world.at([x % y], values)[0] == pytest.approx(values[0] % values[1], abs=1e-15)


def test_larger_and_smaller_of_arrays_are_arrays_of_symbols():
    world = World(0.3, -0.4)
    for name in ("maximum", "minimum", "hypot"):
        with tracing([]):
            found = getattr(np_, name)(symbols(world.symbols), 0.1)
        assert isinstance(found, SymbolArray), name
        np.testing.assert_allclose(world.at(found), getattr(np, name)([0.3, -0.4], 0.1), rtol=1e-15)
        with tracing([]):  # one symbol and plain numbers
            found = getattr(np_, name)(world.symbols[0], np.array([0.1, 0.5]))
            single = getattr(np_, name)(*world.symbols)
        assert isinstance(found, SymbolArray), name
        np.testing.assert_allclose(world.at(found), getattr(np, name)(0.3, [0.1, 0.5]), rtol=1e-15)
        assert world.at([single])[0] == pytest.approx(getattr(np, name)(0.3, -0.4), rel=1e-15)


def test_arrays_of_symbols_go_through_numpy():
    world = World(0.3, -0.4, 0.5)
    x, values = symbols(world.symbols), np.array([0.3, -0.4, 0.5])
    matrix = np.arange(9.0).reshape(3, 3)

    def formula(x, n):
        y = n.zeros(3)
        y[1:] = matrix[1:].dot(x)
        y += n.sin(x) * n.exp(x) + n.maximum(x, 0.1) - n.minimum(0.2, x) + n.clip(x, -0.1, 0.4)
        return n.concatenate([y, n.outer(x, y).ravel(), n.hypot(x, 0.5), [n.vdot(x, y), n.linalg.norm(x), x.max()]])

    with tracing([]):
        traced = formula(x, np_)
    np.testing.assert_allclose(world.at(traced), formula(values, np), rtol=1e-14, atol=1e-15)
    other = np.array([0.9, 0.8, -0.1])  # another order of size: no branch was taken
    np.testing.assert_allclose(world.at(traced, other), formula(other, np), rtol=1e-14, atol=1e-15)
    assert world.guards.expressions == []


def test_outside_a_trace_everything_is_as_it_was():
    """Modules get their own names back, also after an error."""
    from phcontrol.mechanics import kernels, state
    from phcontrol.potentials import frame_potential

    def seen():
        return [frame_potential.np, state.np, state._factor, kernels.factor, vars(frame_potential).get("float")]

    before = seen()

    def fail():
        with tracing([]):
            assert all(now is not then for now, then in zip(seen(), before, strict=True))
            assert type(frame_potential.np.zeros(2)) is not np.ndarray
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert all(now is then for now, then in zip(seen(), before, strict=True))
    assert frame_potential.np is np


def test_zeros_and_what_does_not_depend_on_inputs_are_folded():
    (x,) = World(2.0).symbols
    assert x * 0.0 == 0.0
    assert type(x * 0.0) is float
    assert type(x - x) is Symbol  # NaN where x is none
    assert x + 0.0 is x
    assert x * 1.0 is x
    assert type(0.0 / x) is float


def test_a_branch_is_that_of_the_sample_and_leaves_a_guard():
    world = World(1.0, 2.0)
    x, y = world.symbols
    assert x < y
    assert not x > 1.5
    assert max(x, 0.5) is x
    assert world.guards_at((1.0, 2.0))
    assert not world.guards_at((2.5, 2.0))
    assert not world.guards_at((1.6, 2.0))
    assert not world.guards_at((0.4, 2.0))
    assert not world.guards_at((math.nan, 2.0))


@pytest.mark.parametrize("sample", [1.0, -1.0])
def test_bounds_at_infinity_hold_for_finite_numbers_and_not_for_nan(sample):
    world = World(sample)
    (x,) = world.symbols
    assert x < math.inf
    assert -math.inf <= x
    assert not abs(x) > math.inf
    assert world.guards_at((1e300,))
    assert world.guards_at((-1e300,))
    assert not world.guards_at((math.nan,))


def test_what_would_lose_the_expression_is_refused():
    (x,) = World(1.0).symbols
    with pytest.raises(NotTraceableError, match="plain float"):
        float(x)
    with pytest.raises(NotTraceableError, match="integer"):
        [1, 2, 3][x]
    with pytest.raises(NotTraceableError, match="plain float"):
        math.sin(x)
    with pytest.raises(NotTraceableError, match="eigh"):
        np_.linalg.eigh(symbols([[x, 0.0], [0.0, x]]))
    assert BUILT_IN["float"](x) is x
    assert BUILT_IN["float"]("1.5") == 1.5
    assert isinstance(1.5, BUILT_IN["float"])


def test_factors_and_solutions_are_those_of_numpy(rng):
    B = rng.normal(size=(3, 3))
    M, right = B @ B.T + np.eye(3), rng.normal(size=(3, 2))
    for matrix in (M, B):
        world = World(*matrix.ravel(), *right.ravel())
        entries = symbols(world.symbols)
        A, b = entries[:9].reshape(3, 3), entries[9:].reshape(3, 2)
        found = world.at(solve_square(A, b)).reshape(3, 2)
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-12)
        np.testing.assert_allclose(world.at(np_.linalg.inv(A)).reshape(3, 3), np.linalg.inv(matrix), rtol=1e-12)
    T = np.linalg.cholesky(M)
    world = World(*M.ravel(), *right.ravel())
    entries = symbols(world.symbols)
    found = factor(entries[:9].reshape(3, 3))
    np.testing.assert_allclose(world.at(found).reshape(3, 3), T, rtol=1e-13, atol=1e-15)
    b = entries[9:].reshape(3, 2)
    np.testing.assert_allclose(world.at(solve(found, b)).reshape(3, 2), np.linalg.solve(T, right), rtol=1e-12)
    back = world.at(solve_transposed(found, b)).reshape(3, 2)
    np.testing.assert_allclose(back, np.linalg.solve(T.T, right), rtol=1e-12)


def test_a_pivot_that_shrinks_is_guarded():
    world = World(1.0, 2.0, 3.0, 4.5)
    A = symbols(world.symbols).reshape(2, 2)
    eliminate(A)
    assert world.guards_at((1.0, 2.0, 3.0, 4.5))
    assert not world.guards_at((100.0, 2.0, 1.0, 4.5))
