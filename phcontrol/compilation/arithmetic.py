"""NumPy, ``math``, LAPACK and the kernels as a law sees them while it is traced: they take symbols too."""

from __future__ import annotations

import builtins
import functools
import math
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.linalg import lapack

from phcontrol import _validation
from phcontrol._smooth import exceeds, vanishes
from phcontrol.compilation import eigenvalues, linear_algebra
from phcontrol.compilation.symbol import (
    TRACING,
    Symbol,
    SymbolArray,
    is_real,
    is_symbolic,
    larger,
    refuse,
    symbols,
)
from phcontrol.mechanics import _numpy_frames, kernels


def _array(values: Any, dtype: Any = None, **options: Any) -> Any:
    """Return an array, of objects where it holds a symbol."""
    if dtype is not None and not is_symbolic(values):
        return np.array(values, dtype, **options)
    if not is_real(dtype):
        refuse("numbers that depend on the arm's state are made other ones than floats here")
    made = np.array(values, **options)
    return made.view(SymbolArray) if made.dtype == object else made


def _room(make: Callable[..., Any]) -> Callable[..., Any]:
    """Return a maker of arrays that symbols can be written into."""

    def made(*arguments: Any, **options: Any) -> Any:
        found = make(*arguments, **options)
        return symbols(found) if threading.get_ident() in TRACING and found.dtype == np.float64 else found

    return made


def _elementwise(name: str) -> Callable[..., Any]:
    """Return a function of two numbers or arrays that is no branch where one is a symbol."""
    plain, pairs = getattr(np, name), np.frompyfunc(lambda a, b: _pair(name, a, b), 2, 1)

    def function(first: Any, second: Any, *rest: Any, **options: Any) -> Any:
        if not (is_symbolic(first) or is_symbolic(second)):
            return plain(first, second, *rest, **options)
        if rest or options:
            refuse(f"{name} with options is not traced")
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
    if name != "hypot":
        refuse(f"{name} of a plain number and what depends on the state is not traced")
    return second.hypot(first)


def _clip(values: Any, low: Any, high: Any, *rest: Any, **options: Any) -> Any:
    if not is_symbolic(values):
        return np.clip(values, low, high, *rest, **options)
    if rest or options:
        refuse("clip with options is not traced")
    return _NUMPY["minimum"](_NUMPY["maximum"](values, low), high)


def _norm(value: Any, *rest: Any, **options: Any) -> Any:
    if not is_symbolic(value):
        return np.linalg.norm(value, *rest, **options)
    if rest or options or np.ndim(value) != 1:
        refuse("of norms only that of a vector is traced")
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
        if any(map(is_symbolic, (*arguments, *options.values()))):
            refuse(f"{name} has no closed form that is traced")
        return plain(*arguments, **options)

    return function


class _Function:
    """A function that takes symbols; for other threads, and beside being called, it is the plain one."""

    def __init__(self, plain: Any, traced: Callable[..., Any]) -> None:
        self._plain, self._traced = plain, traced
        functools.update_wrapper(self, plain)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        if threading.get_ident() in TRACING or any(map(_is_traced, (*arguments, *options.values()))):
            return self._traced(*arguments, **options)
        return self._plain(*arguments, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plain, name)


def _is_traced(value: Any) -> bool:
    return type(value) in (Symbol, SymbolArray)


def _questions(name: str) -> Callable[..., Any]:
    """Return what is asked of numbers, each by itself: whether they are finite."""
    plain, each = getattr(np, name), np.frompyfunc(lambda value: _asked(name, value), 1, 1)

    def function(values: Any, *rest: Any, **options: Any) -> Any:
        if not is_symbolic(values):
            return plain(values, *rest, **options)
        if rest or options:
            refuse(f"{name} with options is not traced")
        answers = each(values)
        return np.array(answers, bool) if isinstance(answers, np.ndarray) else answers

    return function


def _asked(name: str, value: Any) -> bool:
    return bool(getattr(value, name)() if type(value) is Symbol else getattr(math, name)(value))


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

_PLAIN_ONLY = (
    *(name for name, found in vars(np).items()
      if isinstance(found, np.ufunc) and not any("O" in kind.partition("->")[0] for kind in found.types)),
    "nan_to_num", "real_if_close", "round", "around", "interp", "digitize", "searchsorted", "histogram", "unwrap",
    "nanmax", "nanmin", "nansum", "nanmean", "fmax", "fmin", "fix", "trunc", "heaviside", "select", "piecewise",
    "array_str", "array_repr", "array2string",
)  # fmt: skip

_NUMPY: dict[str, Any] = {name: _refusing(np, name) for name in _PLAIN_ONLY} | {
    "isfinite": _questions("isfinite"),
    "isnan": _questions("isnan"),
    "isinf": _questions("isinf"),
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


_MATH: dict[str, Any] = {
    name: _function(name)
    for name in ("sin", "cos", "tan", "sqrt", "exp", "log", "asin", "acos", "atan", "atan2", "fmod", "hypot", "tanh",
                 "floor")
}  # fmt: skip
_MATH |= {name: _function(name) for name in ("isfinite", "isnan", "isinf")}


class _FloatLike(type):
    """A ``float`` that leaves symbols as they are."""

    def __call__(cls, value: Any = 0.0) -> Any:
        if isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
            value = value.item()
        return value if type(value) is Symbol else builtins.float(value)

    def __instancecheck__(cls, value: Any) -> bool:
        return isinstance(value, builtins.float)


class _Float(metaclass=_FloatLike):
    dtype = np.dtype(np.float64)  # what NumPy takes it for


def _kernels() -> dict[str, Any]:
    names = ("factor", "solve", "solve_transposed", "relative_factor_rate", "transformed_rate", "momentum_derivative",
             "feedback")  # fmt: skip
    found = {name: _either(getattr(kernels, name), getattr(linear_algebra, name)) for name in names}
    frames = ("frame_wrench", "task_space", "without_task", "hand_damping", "damping_root", "right_inverse_motion",
              "curve_point")  # fmt: skip
    found |= {name: _either(getattr(kernels, name), getattr(_numpy_frames, name)) for name in frames}
    plain = kernels.finite_copy  # the module's own name for it is replaced meanwhile
    return found | {
        "finite_copy": lambda value, size: value if is_symbolic(value) else plain(value, size),
        "modes": _either(kernels.modes, eigenvalues.modes),
    }


def _either(plain: Callable[..., Any], symbolic: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *arguments: (symbolic if any(map(is_symbolic, arguments)) else plain)(*arguments)


_KERNELS = _kernels()
_LAPACK: dict[str, Any] = {
    "dgetrf": linear_algebra.dgetrf,
    "dgetrs": linear_algebra.dgetrs,
    "dpotrf": linear_algebra.dpotrf,
    "dtrtri": linear_algebra.dtrtri,
    "dtrtrs": linear_algebra.dtrtrs,
    "dpotrs": linear_algebra.dpotrs,
    "dsyev": eigenvalues.dsyev,
}


def _with_plain(module: Any, replaced: dict[str, Any]) -> None:
    """Let each function that is replaced be the plain one for other threads."""
    for name in [name for name in replaced if name != "linalg"]:
        replaced[name] = _Function(getattr(module, name), replaced[name])


_with_plain(np, _NUMPY)
_with_plain(math, _MATH)
_with_plain(kernels, _KERNELS)
_with_plain(lapack, _LAPACK)


def _checked(plain: Callable[..., Any]) -> Callable[..., Any]:
    """Return a check of arguments that lets symbols pass: the numbers that they stand for were checked."""

    @functools.wraps(plain)
    def function(name: str, value: Any, *rest: Any, **options: Any) -> Any:
        return value if is_symbolic(value) else plain(name, value, *rest, **options)

    return function


def _exceeds(part: Any, least: Any) -> Any:
    return part.exceeds(least) if type(part) is Symbol else exceeds(part, least)


def _gain(name: str, value: Any, size: int) -> Any:
    """Return a gain as a matrix; guarded against one that is not symmetric and positive definite."""
    array = _array(value)
    if array.dtype != object:
        return _validation.gain(name, value, size)
    if array.ndim < 2:
        array = array * np.eye(size)
    if array.shape != (size, size):
        refuse(f"{name} has shape {np.shape(value)}, where a scalar, {size} numbers or a matrix of them is taken")
    if np.abs(array - array.T).max() > 1e-12 * np.abs(array).max():
        refuse(f"{name} is not symmetric")
    linear_algebra.factor(array)
    return array


STAND_INS: list[tuple[Any, Any]] = [
    (np, _StandIn(np, _NUMPY)),
    (math, _StandIn(math, _MATH)),
    (lapack, _StandIn(lapack, _LAPACK)),
    (kernels, SimpleNamespace(**(vars(kernels) | _KERNELS))),
    *((getattr(kernels, name), function) for name, function in _KERNELS.items()),
    *((getattr(lapack, name), function) for name, function in _LAPACK.items()),
    *((getattr(math, name), function) for name, function in _MATH.items()),
    (exceeds, _Function(exceeds, _exceeds)),
    (vanishes, _Function(vanishes, lambda part: type(part) is not Symbol and vanishes(part))),
    *((check, _checked(check)) for check in (_validation.finite_array, _validation.vector)),
    (_validation.gain, _Function(_validation.gain, _gain)),
]
"""What a module holds, and what stands in for it while its law is traced."""


def _largest(name: str) -> Callable[..., Any]:
    """Return Python's ``max`` or ``min``, of two numbers no branch where one is a symbol."""
    plain, found = getattr(builtins, name), {"max": "maximum", "min": "minimum"}[name]

    def function(*arguments: Any, **options: Any) -> Any:
        if len(arguments) == 2 and not options and any(type(argument) is Symbol for argument in arguments):
            return larger(found, *arguments)
        return plain(*arguments, **options)

    return function


BUILT_IN: dict[str, Any] = {"float": _Float, "max": _largest("max"), "min": _largest("min")}
"""Names of Python itself, and what stands in for them."""
