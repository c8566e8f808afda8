"""Checks at the border: every array and number that comes from outside passes through here once."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phcontrol.exceptions import InvalidArgumentError, UnknownNameError

Array = NDArray[np.float64]
Kind = TypeVar("Kind")

_DECIMAL = re.compile(r"[ \t\r\n]*[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?[ \t\r\n]*")

_SHORT = 40  # characters of what is shown as it is


def decimal(text: str) -> float | None:
    """Return the finite decimal number that a text is, or None.

    ``float`` takes more than files mean: "1_0", "nan", "infinity", digits of other scripts.
    """
    value = float(text) if _DECIMAL.fullmatch(text) else math.nan
    return value if math.isfinite(value) else None


def finite_array(name: str, value: ArrayLike) -> Array:
    """Return a read-only float64 copy of ``value``, or say what about it is not a finite array."""
    if isinstance(value, str):
        raise InvalidArgumentError(name, f"must be an array of real numbers, but is '{value}'")
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iufb":
            raise TypeError(f"holds {raw.dtype} values")
        array = np.array(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidArgumentError(name, f"must be an array of real numbers ({error})") from error
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        index = np.unravel_index(bad[0], array.shape)
        where = f" at index {', '.join(str(int(i)) for i in index)}" if array.ndim else ""
        raise InvalidArgumentError(name, f"must be finite, but is {array[index]}{where}")
    array.flags.writeable = False
    return array


def has_finite_square(array: Array) -> bool:
    """Whether aᵀa of a vector or a number is finite: then it is finite itself, which is found out fast.

    NaN and infinity make the product so, as numbers beyond 1e154 do.
    """
    try:
        return math.isfinite(array.dot(array))
    except Exception:  # what NumPy was told to do where the product over- or underflows
        return False


def real_array(value: Any, shape: tuple[int, ...], *, finite: bool = True) -> Array | None:
    """Return a read-only float64 copy of real numbers of a shape, or None for anything else; never raises.

    Nothing is converted that would change its meaning: no booleans, complex numbers, texts or objects, and no scalar
    where a vector is expected. Without ``finite`` NaN passes (an object that is not seen), infinity never does.
    """
    try:
        raw = value if type(value) is np.ndarray else np.asarray(value)
        if raw.dtype.kind not in "fiu" or raw.shape != shape:
            return None
        array: Array = np.array(raw, dtype=np.float64)
        if not has_finite_square(array) and (~np.isfinite(array) if finite else np.isinf(array)).any():
            return None
    except Exception:  # whatever a foreign object raises when it is asked for its numbers
        return None
    array.flags.writeable = False
    return array


def vector(name: str, value: ArrayLike, size: int) -> Array:
    """Return ``value`` as a finite read-only vector of length ``size``."""
    array = finite_array(name, value)
    if array.shape != (size,):
        raise InvalidArgumentError(name, f"must have shape ({size},), but has shape {array.shape}")
    return array


def per_joint(name: str, value: ArrayLike, size: int) -> Array:
    """Return a number for all joints, or a vector of one each, as a finite read-only vector of length ``size``."""
    array = finite_array(name, value)
    return vector(name, np.full(size, array) if array.ndim == 0 else array, size)


def positive_vector(name: str, value: ArrayLike, size: int) -> Array:
    """Return a number > 0 for all joints, or a vector of one each, as a finite read-only vector of length ``size``."""
    array = per_joint(name, value, size)
    if not (array > 0.0).all():
        raise InvalidArgumentError(name, f"must be > 0, but its smallest entry is {array.min():g}")
    return array


def sequence(name: str, values: Any, kind: str, *attributes: str) -> tuple[Any, ...]:
    """Return a sequence as a tuple; each of its items must have the ``attributes`` that make it a ``kind``."""
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable):
        raise InvalidArgumentError(name, f"must be a sequence of {kind}, but is {values!r}")
    items = tuple(values)
    for item in items:
        if not all(hasattr(item, attribute) for attribute in attributes):
            raise InvalidArgumentError(name, f"must hold {kind}, but one is {type(item).__name__}")
    return items


def matrix(name: str, value: ArrayLike, size: int) -> Array:
    """Return a scalar, a vector (a diagonal) or a square matrix as a finite (size, size) matrix."""
    array = finite_array(name, value)
    if array.shape == ():
        array = array * np.eye(size)
    elif array.shape == (size,):
        array = np.diag(array)
    if array.shape != (size, size):
        raise InvalidArgumentError(
            name,
            f"must be a scalar, a vector of length {size} or a ({size}, {size}) matrix, but has shape {array.shape}",
        )
    array.flags.writeable = False
    return array


def gain(name: str, value: ArrayLike, size: int) -> Array:
    """Return a gain as a symmetric positive-definite (size, size) matrix."""
    array = matrix(name, value, size)
    if np.abs(array - array.T).max() > 1e-12 * np.abs(array).max():
        raise InvalidArgumentError(name, "must be symmetric")
    smallest = float(np.linalg.eigvalsh(array)[0])
    if smallest <= 0.0:
        raise InvalidArgumentError(name, f"must be positive definite, but its smallest eigenvalue is {smallest:g}")
    return array


def is_rotation(matrix: Array, tolerance: float = 1e-9) -> bool:
    """Return whether a (3, 3) matrix is orthogonal to within a tolerance, and turns without reflecting."""
    return bool(np.abs(matrix @ matrix.T - np.eye(3)).max() <= tolerance and np.linalg.det(matrix) > 0.0)


def check_homogeneous(name: str, value: Array) -> None:
    """Raise InvalidArgumentError unless a (4, 4) matrix ends like a homogeneous one."""
    if not np.array_equal(value[3], [0.0, 0.0, 0.0, 1.0]):
        raise InvalidArgumentError(name, f"must have the last row (0, 0, 0, 1), but has {value[3]}")


def rotation(name: str, value: ArrayLike) -> Array:
    """Return ``value`` as a finite read-only rotation matrix, shape (3, 3)."""
    array = finite_array(name, value)
    if array.shape != (3, 3):
        raise InvalidArgumentError(name, f"must be a rotation matrix of shape (3, 3), but has shape {array.shape}")
    if not is_rotation(array):
        raise InvalidArgumentError(
            name, f"must be a rotation matrix of shape (3, 3), R Rᵀ = 1 and det R = 1, but is {array.tolist()}"
        )
    return array


def direction(name: str, value: ArrayLike) -> Array:
    """Return ``value`` as a read-only unit vector of length 3."""
    array = vector(name, value, 3)
    length = float(np.linalg.norm(array))
    if not 1e-9 <= length < math.inf:
        raise InvalidArgumentError(name, f"must not be zero, nor too large to be scaled, but has length {length:g}")
    array = array / length
    array.flags.writeable = False
    return array


def number(
    name: str, value: float, *, minimum: float = -math.inf, exclusive: bool = False, maximum: float = math.inf
) -> float:
    """Return ``value`` as a finite float inside its bounds."""
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidArgumentError(name, f"must be a number, but is {value!r}") from error
    if isinstance(value, str) and math.isfinite(result) and decimal(value) is None:
        raise InvalidArgumentError(name, f"must be a number, but is {value!r}")
    if not math.isfinite(result):
        raise InvalidArgumentError(name, f"must be finite, but is {result}")
    if result < minimum or (exclusive and result == minimum):
        raise InvalidArgumentError(name, f"must be {'>' if exclusive else '>='} {minimum:g}, but is {result:g}")
    if result > maximum:
        raise InvalidArgumentError(name, f"must be <= {maximum:g}, but is {result:g}")
    return result


def positive(name: str, value: float, *, maximum: float = math.inf) -> float:
    """Return ``value`` as a finite float > 0, and not above ``maximum``."""
    return number(name, value, minimum=0.0, exclusive=True, maximum=maximum)


def count(name: str, value: int, *, minimum: int = 1, maximum: int = 2**63 - 1) -> int:
    """Return ``value`` as an integer not below ``minimum`` nor above ``maximum``."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < minimum:
        raise InvalidArgumentError(name, f"must be an integer >= {minimum}, but is {value!r}")
    if value > maximum:
        raise InvalidArgumentError(name, f"must be at most {maximum:g}, but has {len(str(value))} digits")
    return int(value)


def flag(name: str, value: bool) -> bool:
    """Return ``value`` when it is True or False."""
    if not isinstance(value, bool):
        raise InvalidArgumentError(name, f"must be True or False, but is {value!r}")
    return value


def text(name: str, value: Any) -> str:
    """Return ``value`` when it is a string that is not empty: the name of something."""
    if not isinstance(value, str) or not value:
        raise InvalidArgumentError(name, f"must be a name, but is {value!r}")
    return value


def instance(name: str, value: Any, kind: type[Kind]) -> Kind:
    """Return ``value`` when it is a ``kind``."""
    if not isinstance(value, kind):
        raise InvalidArgumentError(name, f"must be a {kind.__name__}, but is {type(value).__name__}")
    return value


def file_path(name: str, value: Any) -> Path:
    """Return ``value`` as a path; a number is none, though the system would take it for an open file."""
    if not isinstance(value, (str, os.PathLike)) or not isinstance(os.fspath(value), str):
        raise InvalidArgumentError(name, f"must be the path of a file, but is {value!r}")
    if "\0" in os.fspath(value):
        raise InvalidArgumentError(name, f"cannot hold a NUL, but is {os.fspath(value)!r}")
    return Path(value)


def choice(kind: str, value: Any, options: Iterable[str]) -> str:
    """Return ``value`` when it is one of ``options``, else list them."""
    known = list(options)
    if not isinstance(value, str) or value not in known:
        raise UnknownNameError(kind, str(value), known)
    return str(value)


def whole_multiple(name: str, period: float, step: float) -> int:
    """Return how many steps [s] make a period [s]; it must be a whole number."""
    ratio = min(positive(name, period) / step, 1e15)
    multiple = round(ratio)
    if multiple < 1 or abs(ratio - multiple) > 1e-6 * multiple:
        raise InvalidArgumentError(name, f"must be a whole multiple of dt = {step:g} s, but is {period:g} s")
    return multiple


def described(value: object) -> str:
    """Return in words what a method returned."""
    if isinstance(value, np.ndarray):
        kind = "" if value.dtype.kind in "fiu" else f" of {value.dtype}"
        return f"an array of shape {value.shape}{kind}"
    if value is None or isinstance(value, (bool, int, float, complex, str)):
        return repr(value)
    if isinstance(value, (tuple, list)) and len(repr(value)) < _SHORT:
        return repr(value)
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiouAEIO' else 'a'} {name}"
