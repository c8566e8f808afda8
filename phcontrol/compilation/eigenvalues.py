"""Eigenvalues and eigenvectors of symmetric matrices of symbols, in a number of operations that is always the same."""

from __future__ import annotations

import functools
import itertools
import weakref
from typing import Any

import casadi
import numpy as np
from scipy.linalg import lapack

from phcontrol.compilation.symbol import Symbol, SymbolArray, is_symbolic, refuse, sample_of, symbols

_SWEEPS = {2: 1, 3: 5, 4: 6, 5: 6, 6: 6}
"""Times that all pairs are turned, by the size of the matrix; of 6, at 6000 postures of a UR5, 5 leave 4e-13."""
LEFT = 1e-13
"""Of the diagonal, what may be left beside it: eigenvalues are then true to its square."""
_MORE = 3  # sweeps in C, which ends when nothing is left to turn
_LEAST = 1e-33  # the square of an entry, of the product of those on the diagonal, below which it counts as 0
_TINY = 1e-300  # under a root, so that what is not turned is not divided by 0


class Eigenvalues:
    """One decomposition in a trace: a function that is called in C, and whose results are symbols of their own.

    Args:
        size: n.
        given: the lower triangle, row by row, whether it is asked for, and what the eigenvalues are where it is not: a
            vector of ``casadi.SX``.
    """

    def __init__(self, size: int, given: Any) -> None:
        self.number = next(_numbers)
        """In the order in which decompositions were asked for."""
        self.size, self.given = size, given
        self.results = casadi.SX.sym(f"{_PREFIX}{self.number}", size + size * size + 1)
        """Symbols: n eigenvalues in ascending order, n eigenvectors, and what is left beside the diagonal."""
        _blocks[self.number] = self


_PREFIX = "eigenvalues_"
_numbers = itertools.count()
_blocks: weakref.WeakValueDictionary[int, Eigenvalues] = weakref.WeakValueDictionary()


def blocks_of(expressions: Any) -> list[Eigenvalues]:
    """Return the decompositions whose results are in expressions, and those that they need, in the order of asking."""
    found: dict[int, Eigenvalues] = {}
    waiting = [expressions]
    while waiting:
        names = (symbol.name() for symbol in casadi.symvar(waiting.pop()))
        numbers = {int(name[len(_PREFIX) :].partition("_")[0]) for name in names if name.startswith(_PREFIX)}
        for number in numbers - set(found):
            found[number] = _blocks[number]
            waiting.append(found[number].given)
    return [found[number] for number in sorted(found)]


def dsyev(matrix: Any, compute_v: int = 1, **options: Any) -> Any:
    """Return eigenvalues, in ascending order, eigenvectors and 0, as LAPACK does.

    Jacobi's method, with a fixed number of sweeps in which pairs that do not touch each other are turned together;
    that hardly anything is left beside the diagonal is a bound, outside of which the interpreted law answers.
    Eigenvectors have no signs of their own, and those of equal eigenvalues no directions: functions of the matrix are
    those of LAPACK's, single vectors need not be.
    """
    if not is_symbolic(matrix):
        return lapack.dsyev(matrix, compute_v=compute_v, **options)
    if options:
        refuse("eigenvalues of a matrix with options are not traced")
    if not any(type(entry) is Symbol for entry in matrix.ravel()):
        return lapack.dsyev(np.array(matrix, dtype=float), compute_v=compute_v)
    values, columns = modes(matrix, 1.0, 0.0)
    return values, columns, 0


def modes(matrix: Any, doubt: Any, otherwise: Any) -> tuple[SymbolArray, SymbolArray]:
    """Return eigenvalues and eigenvectors as ``kernels.modes`` does, only where ``doubt`` > 0."""
    n = len(matrix)
    if n not in _SWEEPS:
        refuse(f"eigenvalues of a matrix of {n} rows are not traced")
    lower = [matrix[i, j] for i in range(n) for j in range(i + 1)]
    guards = next(entry.guards for entry in (*lower, doubt) if type(entry) is Symbol)
    needed, asked = _expression(doubt) > 0.0, float(sample_of(doubt) > 0.0)
    given = casadi.vertcat(*(_expression(entry) for entry in lower), needed, _expression(otherwise))
    block = Eigenvalues(n, given)
    guards.blocks.append(block)
    numbers = np.array([*(sample_of(entry) for entry in lower), asked, sample_of(otherwise)])
    samples = np.array(decomposition(n)(numbers)).ravel()
    made = [
        Symbol(one, float(sample), guards) for one, sample in zip(casadi.vertsplit(block.results), samples, strict=True)
    ]
    guards.bounds.append(made[-1].expression <= LEFT**2)
    columns: SymbolArray = symbols(made[n:-1]).reshape(n, n).T.view(SymbolArray)
    return symbols(made[:n]), columns


def written_out(expressions: Any) -> Any:
    """Return expressions in which the results of decompositions are what they are computed by."""
    for block in reversed(blocks_of(expressions)):
        expressions = casadi.substitute(expressions, block.results, decomposition(block.size)(block.given))
    return expressions


def _expression(entry: Any) -> Any:
    return entry.expression if type(entry) is Symbol else casadi.SX(float(entry))


def _rounds(n: int) -> list[list[tuple[int, int]]]:
    """Return all pairs of n, in rounds of pairs that do not touch each other."""
    ring = list(range(n + n % 2))
    rounds = []
    for _ in range(len(ring) - 1):
        half = len(ring) // 2
        pairs = zip(ring[:half], reversed(ring[half:]), strict=True)
        rounds.append([(min(pair), max(pair)) for pair in pairs if max(pair) < n])
        ring = [ring[0], ring[-1], *ring[1:-1]]
    return rounds


@functools.cache
def decomposition(n: int) -> Any:
    """Return the function of what ``Eigenvalues`` is given: eigenvalues, columns of vectors, and what is left beside.

    The last is the square of the off-diagonal entries over that of the diagonal. It is what ``c_text`` is in C.
    """
    given = casadi.SX.sym("A", n * (n + 1) // 2 + 2)
    *lower, needed, otherwise = casadi.vertsplit(given)
    entries = iter(lower)
    A = [[next(entries) for _ in range(i + 1)] for i in range(n)]
    V: list[list[Any]] = [[casadi.SX(float(i == j)) for j in range(n)] for i in range(n)]  # V[k]: column k

    def place(i: int, j: int) -> tuple[int, int]:
        return (i, j) if i >= j else (j, i)

    for sweep in range(_SWEEPS[n]):
        for pairs in _rounds(n):
            for p, q in pairs:
                a, d = A[q][p], A[q][q] - A[p][p]
                root = casadi.sqrt(d * d + 4.0 * (a * a) + _TINY)
                tangent = (a + a) / (d + casadi.copysign(root, d))
                cosine = 1.0 / casadi.sqrt(1.0 + tangent * tangent)
                sine = tangent * cosine
                A[p][p], A[q][q], A[q][p] = A[p][p] - tangent * a, A[q][q] + tangent * a, casadi.SX(0.0)
                for k in range(n):
                    if k in (p, q):
                        continue
                    (i, j), (r, s) = place(k, p), place(k, q)
                    A[i][j], A[r][s] = cosine * A[i][j] - sine * A[r][s], sine * A[i][j] + cosine * A[r][s]
                first = sweep == 0
                V[p], V[q] = _turned(V[p], V[q], cosine, sine, first)
    left = casadi.SX(0.0)
    for i in range(n):
        for j in range(i):
            left += A[i][j] * A[i][j]
    values = [A[i][i] for i in range(n)]
    size = casadi.sum1(casadi.vertcat(*(value * value for value in values)))
    for end in reversed(range(1, n)):  # in ascending order
        for i in range(end):
            falls = values[i] > values[i + 1]
            values[i], values[i + 1] = casadi.fmin(values[i], values[i + 1]), casadi.fmax(values[i], values[i + 1])
            V[i], V[i + 1] = _either(falls, V[i + 1], V[i]), _either(falls, V[i], V[i + 1])
    vectors = [entry for column in V for entry in column]
    found = [casadi.if_else(needed, value, otherwise) for value in values]
    rest = [casadi.if_else(needed, entry, 0.0) for entry in (*vectors, left / (size + _TINY))]
    return casadi.Function("eigenvalues", [given], [casadi.vertcat(*found, *rest)])


def _turned(first: list[Any], second: list[Any], cosine: Any, sine: Any, has_zeros: bool) -> tuple[Any, Any]:
    """Return two columns turned; at first most of their entries are 0."""

    def sum_of(a: Any, x: Any, b: Any, y: Any) -> Any:
        terms = [factor * value for factor, value in ((a, x), (b, y)) if not (has_zeros and value.is_zero())]
        return terms[0] + terms[1] if len(terms) == 2 else terms[0] if terms else casadi.SX(0.0)

    pairs = list(zip(first, second, strict=True))
    return [sum_of(cosine, x, -sine, y) for x, y in pairs], [sum_of(sine, x, cosine, y) for x, y in pairs]


def _either(condition: Any, yes: list[Any], no: list[Any]) -> list[Any]:
    return [casadi.if_else(condition, a, b) for a, b in zip(yes, no, strict=True)]


def c_text(name: str, n: int, literal: Any, suffix: str) -> tuple[str, int]:
    """Return a C function ``name(given, out)`` that decomposes matrices of n rows, and its operations at most.

    A sweep is written out, so that the roots and quotients of pairs that do not touch each other go on side by side.

    Args:
        name: of the function.
        n: rows.
        literal: writes a number as C.
        suffix: of the functions of <math.h>.
    """
    rounds, most, size = _rounds(n), _SWEEPS[n] + _MORE, n * (n + 1) // 2
    one, four, tiny, least = literal(1.0), literal(4.0), literal(_TINY), literal(_LEAST)
    pairs = [(q, p) for q in range(n) for p in range(q)]
    small = " && ".join(f"{_at(q, p)} * {_at(q, p)} <= {least} * fabs{suffix}(D{p} * D{q})" for q, p in pairs)
    small = small.replace("D", "diagonal_").replace(" && ", " &&\n        ")
    lines = [f"const real {', '.join(f'diagonal_{i} = {_at(i, i)}' for i in range(n))};", f"if ({small})\n      break;"]
    for turns in rounds:
        for k, (p, q) in enumerate(turns):
            lines.append(f"a = {_at(q, p)}, d = {_at(q, q)} - {_at(p, p)};")
            lines.append(
                f"t{k} = (a + a) / (d + copysign{suffix}(sqrt{suffix}(d * d + {four} * (a * a) + {tiny}), d));"
            )
            lines.append(f"c{k} = {one} / sqrt{suffix}({one} + t{k} * t{k}), s{k} = t{k} * c{k};")
            lines.append(f"{_at(p, p)} -= t{k} * a, {_at(q, q)} += t{k} * a, {_at(q, p)} = 0;")
        for k, (p, q) in enumerate(turns):
            for other in range(n):
                if other not in (p, q):
                    x, y = _at(other, p), _at(other, q)
                    lines.append(f"x = {x}, y = {y}, {x} = c{k} * x - s{k} * y, {y} = s{k} * x + c{k} * y;")
            lines.append(f"TURN(V[{p}], V[{q}], c{k}, s{k})")
    sweep = "\n    ".join(lines)
    values = ", ".join(_at(i, i) for i in range(n))
    beside = " + ".join(f"{_at(q, p)} * {_at(q, p)}" for q, p in pairs)
    scalars = ", ".join(f"{letter}{k}" for k in range(n // 2) for letter in "tcs")
    text = f"""#define TURN(v, w, c, s) \\
  for (k = 0; k < {n}; k++) {{ \\
    const real x_ = v[k], y_ = w[k]; \\
    v[k] = c * x_ - s * y_; \\
    w[k] = s * x_ + c * y_; \\
  }}
static void {name}(const real *given, real *out) {{
  real A[{size}], V[{n}][{n}], a, d, x, y, size = 0, {scalars};
  int i, j, k, sweep;
  if (!(given[{size}] != 0)) {{ /* not asked for */
    for (i = 0; i <= {n + n * n}; i++) out[i] = i < {n} ? given[{size + 1}] : 0;
    return;
  }}
  for (i = 0; i < {size}; i++) A[i] = given[i];
  for (i = 0; i < {n}; i++)
    for (j = 0; j < {n}; j++) V[i][j] = (real)(i == j);
  for (sweep = 0; sweep < {most}; sweep++) {{
    {sweep}
  }}
  {{
    const real values[{n}] = {{{values}}};
    for (i = 0; i < {n}; i++) {{
      out[i] = values[i];
      size += values[i] * values[i];
    }}
  }}
  for (j = {n} - 1; j > 0; j--)
    for (i = 0; i < j; i++) {{
      const real low = out[i], high = out[i + 1];
      if (!(low > high)) continue;
      out[i] = high;
      out[i + 1] = low;
      for (k = 0; k < {n}; k++) {{
        const real v = V[i][k];
        V[i][k] = V[i + 1][k];
        V[i + 1][k] = v;
      }}
    }}
  for (i = 0; i < {n * n}; i++) out[{n} + i] = V[i / {n}][i % {n}];
  out[{n + n * n}] = ({beside}) / (size + {tiny});
}}
#undef TURN
"""
    return text, most * len(pairs) * (20 + 12 * n) + n * (n + 4)


def _at(i: int, j: int) -> str:
    """Return the place of an entry in a lower triangle, as C writes it."""
    i, j = max(i, j), min(i, j)
    return f"A[{i * (i + 1) // 2 + j}]"
