"""Eigenvalues of symbols are those of LAPACK, and so are functions of matrices made by them, in C too."""

from __future__ import annotations

import ctypes

import casadi
import numpy as np
import pytest
from scipy.linalg import lapack

from phcontrol import NotTraceableError
from phcontrol.compilation.c_code import function
from phcontrol.compilation.eigenvalues import blocks_of, dsyev, written_out
from phcontrol.compilation.symbol import Guards, Symbol, symbols

SIZES = (2, 3, 4, 5, 6)


def matrices(size, count, seed):
    """Return symmetric matrices: wide spectra, eigenvalues that are equal or nearly so, a zero one, diagonal ones."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        turn = np.linalg.qr(rng.normal(size=(size, size)))[0]
        values = 10.0 ** rng.uniform(-3.0, 3.0, size)
        if k % 5 == 0:
            values = 10.0 ** rng.uniform(-10.0, 3.0, size)
        elif k % 5 == 1:
            values = values[0] * (1.0 + 10.0 ** -rng.uniform(4.0, 14.0) * rng.normal(size=size))
        elif k % 5 == 2:
            values[: size // 2 + 1] = values[0]
        elif k % 5 == 3:
            values[0] = 0.0
        matrix = (turn * values) @ turn.T if k % 10 != 9 else np.diag(values)
        yield 0.5 * (matrix + matrix.T)


def traced(size):
    """Return the inputs, guards and results (values, then V√(1 + λ²)Vᵀ) of a matrix of symbols."""
    inputs, guards = casadi.SX.sym("v", size * size), Guards()
    first = next(matrices(size, 1, 1)).ravel()
    entries = [Symbol(one, float(sample), guards) for one, sample in zip(casadi.vertsplit(inputs), first, strict=True)]
    values, vectors, status = dsyev(symbols(entries).reshape(size, size))
    assert status == 0
    scaled = vectors * symbols([(1.0 + value * value) ** 0.5 for value in values])
    root = scaled.dot(vectors.T)
    return inputs, guards, [entry.expression for entry in (*values, *root.ravel())], values


def expected(matrix):
    values, vectors, _ = lapack.dsyev(matrix)
    return np.append(values, ((vectors * np.sqrt(1.0 + values**2)) @ vectors.T).ravel())


def library_of(size, compiler, folder, single=False):
    """Compile the trace of a matrix; return a function of matrices that gives results, or None by its guards."""
    inputs, guards, results, _ = traced(size)
    rest = [casadi.SX.sym(name, 0) for name in "qsmp"]
    t = casadi.SX.sym("t")
    text = function("f", [t, rest[0], inputs, *rest[1:]], guards.conditions, results, single).text
    real = "float" if single else "double"
    arguments = "t, q, v, s, m, p, out"
    declared = "real t, const real *q, const real *v, const real *s, const real *m, const real *p, real *out"
    source, target = folder / "f.c", folder / "f.so"
    source.write_text(
        f"#include <math.h>\ntypedef {real} real;\n{text}\nint g({declared});\n"
        f"int g({declared}) {{ return f({arguments}); }}\n"
    )
    compiler.compile(source, target, native=False)
    kind = ctypes.c_float if single else ctypes.c_double
    pointer = ctypes.POINTER(kind)
    called = ctypes.CDLL(str(target)).g
    called.argtypes, called.restype = [kind, *[pointer] * 6], ctypes.c_int
    none = np.zeros(1, dtype=kind).ctypes.data_as(pointer)

    def compute(matrix):
        given, out = np.ascontiguousarray(matrix, dtype=kind), np.zeros(len(results), dtype=kind)
        found = called(0.0, none, given.ctypes.data_as(pointer), none, none, none, out.ctypes.data_as(pointer))
        return out if found else None

    return compute


@pytest.mark.parametrize("size", SIZES)
def test_functions_of_matrices_in_c_are_those_of_lapack(size, compiler, tmp_path):
    compute = library_of(size, compiler, tmp_path)
    for matrix in matrices(size, 400, seed=size):
        wanted, found = expected(matrix), compute(matrix)
        assert found is not None
        assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()
        assert (np.diff(found[:size]) >= 0.0).all()
    assert compute(np.full((size, size), np.nan)) is None  # and what is no number is left to the interpreted law


def test_in_single_precision_too(compiler, tmp_path):
    compute = library_of(6, compiler, tmp_path, single=True)
    for matrix in matrices(6, 100, seed=3):
        wanted, found = expected(matrix), compute(matrix)
        assert np.abs(found - wanted).max() <= 2e-5 * np.abs(wanted).max()


@pytest.mark.parametrize("size", SIZES)
def test_written_out_they_are_the_same(size):
    inputs, _, results, _ = traced(size)
    wanted = casadi.vertcat(*results)
    assert len(blocks_of(wanted)) == 1
    whole = written_out(wanted)
    assert not blocks_of(whole)
    compute = casadi.Function("f", [inputs], [whole])
    for matrix in matrices(size, 60, seed=size + 10):
        right = expected(matrix)
        assert np.abs(np.array(compute(matrix.ravel())).ravel() - right).max() <= 1e-11 * np.abs(right).max()


def test_samples_are_eigenvalues_of_the_sample():
    _, _, _, values = traced(6)
    wanted = np.linalg.eigvalsh(next(matrices(6, 1, 1)))
    np.testing.assert_allclose([value.sample for value in values], wanted, atol=1e-12 * wanted.max())


def test_plain_matrices_are_lapacks_and_large_ones_are_refused():
    matrix = next(matrices(6, 1, 2))
    for one, other in zip(dsyev(matrix), lapack.dsyev(matrix), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(dsyev(symbols(matrix))[0], lapack.dsyev(matrix)[0])
    guards = Guards()
    large = symbols(np.eye(7))
    large[0, 0] = Symbol(casadi.SX.sym("x"), 1.0, guards)
    with pytest.raises(NotTraceableError, match="eigenvalues of a matrix of 7 rows"):
        dsyev(large)
