"""NumPy, ``math``, LAPACK and the kernels as a law sees them while it is traced: they take symbols too."""

from __future__ import annotations

import builtins
import math
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.linalg import lapack

from phcontrol.compilation import linear_algebra
from phcontrol.compilation.errors import NotTraceableError
from phcontrol.compilation.symbol import Symbol, SymbolArray, is_symbolic, larger, symbols
from phcontrol.mechanics import kernels

TRACING: set[int] = set()
"""The thread that traces: others that run laws meanwhile get plain arrays, as ever."""


def _array(values: Any, dtype: Any = None, **options: Any) -> Any:
    """Return an array, of objects where it holds a symbol."""
    made = np.array(values, **options) if dtype is None or is_symbolic(values) else np.array(values, dtype, **options)
    return made.view(SymbolArray) if made.dtype == object else made


def _room(make: Callable[..., Any]) -> Callable[..., Any]:
    """Return a maker of arrays that symbols can be written into."""

    def made(*arguments: Any, dtype: Any = None, **options: Any) -> Any:
        if threading.get_ident() not in TRACING or dtype not in (None, float, np.float64, FLOAT):
            return make(*arguments, dtype=dtype, **options)
        return symbols(make(*arguments, **options))

    return made


def _elementwise(name: str) -> Callable[..., Any]:
    """Return a function of two numbers or arrays that is no branch where one is a symbol."""
    plain, pairs = getattr(np, name), np.frompyfunc(lambda a, b: _pair(name, a, b), 2, 1)

    def function(first: Any, second: Any, *rest: Any, **options: Any) -> Any:
        if not (is_symbolic(first) or is_symbolic(second)):
            return plain(first, second, *rest, **options)
        result = pairs(first, second)
        return result.view(SymbolArray) if isinstance(result, np.ndarray) else result

    return function


def _pair(name: str, first: Any, second: Any) -> Any:
    """Return a function of two numbers, of which either may be a symbol."""
    if name in ("maximum", "minimum"):
        return larger(name, first, second)
    if type(first) is Symbol:  # its functions are its methods
        return getattr(first, name)(second)
    if type(second) is not Symbol:
        return float(getattr(np, name)(first, second))
    if name == "hypot":
        return second.hypot(first)
    raise NotTraceableError(f"{name} of a plain number and what depends on the state is not traced")


def _clip(values: Any, low: Any, high: Any, *rest: Any, **options: Any) -> Any:
    if not is_symbolic(values):
        return np.clip(values, low, high, *rest, **options)
    return _NUMPY["minimum"](_NUMPY["maximum"](values, low), high)


def _norm(value: Any, *rest: Any, **options: Any) -> Any:
    if not is_symbolic(value):
        return np.linalg.norm(value, *rest, **options)
    if rest or options or np.ndim(value) != 1:
        raise NotTraceableError("of norms only that of a vector is traced")
    return value.dot(value) ** 0.5


def _inverse(matrix: Any) -> Any:
    if not is_symbolic(matrix):
        return np.linalg.inv(matrix)
    return linear_algebra.solve_square(matrix, np.eye(len(matrix)))


def _solve(matrix: Any, right: Any) -> Any:
    if not (is_symbolic(matrix) or is_symbolic(right)):
        return np.linalg.solve(matrix, right)
    if not is_symbolic(matrix):
        return np.linalg.solve(matrix, np.eye(len(matrix))).dot(right)
    return linear_algebra.solve_square(matrix, right)


def _refusing(module: Any, name: str) -> Callable[..., Any]:
    """Return a function that takes plain numbers only."""
    plain = getattr(module, name)

    def function(*arguments: Any, **options: Any) -> Any:
        if any(map(is_symbolic, arguments)):
            raise NotTraceableError(f"{name} has no closed form that is traced")
        return plain(*arguments, **options)

    return function


class _StandIn:
    """A module with some of its names replaced."""

    def __init__(self, module: Any, replaced: dict[str, Any]) -> None:
        self._module = module
        self.__dict__.update(replaced)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


_MATRIX_FUNCTIONS = (
    "eig", "eigh", "eigvals", "eigvalsh", "svd", "svdvals", "qr", "det", "slogdet", "pinv", "lstsq", "cond",
    "matrix_rank", "cholesky", "matrix_power",
)  # fmt: skip

_NUMPY: dict[str, Any] = {
    "array": _array,
    "zeros": _room(np.zeros),
    "zeros_like": _room(np.zeros_like),
    "ones": _room(np.ones),
    "empty": _room(np.zeros),
    "empty_like": _room(np.zeros_like),
    "full": _room(np.full),
    "maximum": _elementwise("maximum"),
    "minimum": _elementwise("minimum"),
    "hypot": _elementwise("hypot"),
    "arctan2": _elementwise("arctan2"),
    "clip": _clip,
    "linalg": _StandIn(
        np.linalg,
        {"norm": _norm, "inv": _inverse, "solve": _solve}
        | {name: _refusing(np.linalg, name) for name in _MATRIX_FUNCTIONS},
    ),
}

_MATH_NAMES = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2"}


def _function(name: str) -> Callable[..., Any]:
    plain, method = getattr(math, name), _MATH_NAMES.get(name, name)

    def function(first: Any, *rest: Any) -> Any:
        if type(first) is Symbol:
            return getattr(first, method)(*rest)
        if rest and type(rest[0]) is Symbol:
            return _pair(method, first, rest[0])
        return plain(first, *rest)

    return function


def _of_finite(name: str, answer: bool) -> Callable[[Any], bool]:
    """Return what is asked of a number: a symbol stands for finite ones, as the border lets no others in."""
    plain = getattr(math, name)
    return lambda value: answer if type(value) is Symbol else plain(value)


_MATH: dict[str, Any] = {
    name: _function(name)
    for name in ("sin", "cos", "tan", "sqrt", "exp", "log", "asin", "acos", "atan", "atan2", "fmod", "hypot", "tanh",
                 "floor")
}  # fmt: skip
_MATH |= {"isfinite": _of_finite("isfinite", True), "isnan": _of_finite("isnan", False)}
_MATH |= {"isinf": _of_finite("isinf", False)}


class _FloatLike(type):
    """A ``float`` that leaves symbols as they are."""

    def __call__(cls, value: Any = 0.0) -> Any:
        if isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
            value = value.item()
        return value if type(value) is Symbol else builtins.float(value)

    def __instancecheck__(cls, value: Any) -> bool:
        return isinstance(value, builtins.float)


class _Float(metaclass=_FloatLike):
    pass


def _kernels() -> dict[str, Any]:
    names = ("factor", "solve", "solve_transposed", "relative_factor_rate", "transformed_rate", "momentum_derivative",
             "feedback")  # fmt: skip
    found = {name: _either(getattr(kernels, name), getattr(linear_algebra, name)) for name in names}
    plain = kernels.finite_copy  # the module's own name for it is replaced meanwhile
    return found | {"finite_copy": lambda value, size: value if is_symbolic(value) else plain(value, size)}


def _either(plain: Callable[..., Any], symbolic: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *arguments: (symbolic if any(map(is_symbolic, arguments)) else plain)(*arguments)


_KERNELS = _kernels()
_LAPACK = {
    "dgetrf": linear_algebra.dgetrf,
    "dgetrs": linear_algebra.dgetrs,
    "dtrtri": linear_algebra.dtrtri,
    "dpotrs": linear_algebra.dpotrs,
    "dsyev": _refusing(lapack, "dsyev"),
}

STAND_INS: list[tuple[Any, Any]] = [
    (np, _StandIn(np, _NUMPY)),
    (math, _StandIn(math, _MATH)),
    (lapack, _StandIn(lapack, _LAPACK)),
    (kernels, SimpleNamespace(**(vars(kernels) | _KERNELS))),
    *((getattr(kernels, name), function) for name, function in _KERNELS.items()),
    *((getattr(lapack, name), function) for name, function in _LAPACK.items()),
    *((getattr(math, name), function) for name, function in _MATH.items()),
]
"""What a module holds, and what stands in for it while its law is traced."""
FLOAT: Any = _Float
"""Stands in for ``float``."""
