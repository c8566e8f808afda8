"""A symbolic scalar that computes a sample beside, and arrays of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import casadi
import numpy as np

from phcontrol.compilation.errors import NotTraceableError

_LARGEST = float(np.finfo(np.float64).max)


class Guards:
    """The conditions under which a trace is right: each an expression, and what it was when the trace was made."""

    def __init__(self) -> None:
        self._found: dict[tuple[int, bool], Any] = {}
        self.expressions: list[Any] = []
        """Expressions that are all 1 where the trace is right."""

    def take(self, condition: Any, sample: bool) -> bool:
        """Take the sample's branch of an ``if``, and note its condition."""
        if condition.is_constant():
            return bool(float(condition))
        key = condition.element_hash(), sample
        if key not in self._found:
            self._found[key] = condition  # kept alive: its hash is its address
            self.expressions.append(condition if sample else casadi.logic_not(condition))
        return sample


class Symbol:
    """A real number of which an expression is written down, with the value that it has at a sample.

    It adds, multiplies and compares like a float, alone and in NumPy arrays of objects, whose functions (``np.sin``,
    ``np.hypot``) find theirs by name. A comparison gives the sample's answer and leaves a guard. What does not depend
    on any input is a plain float again, and what is multiplied by 0 is 0.

    Args:
        expression: a scalar ``casadi.SX``.
        sample: its value there.
        guards: where conditions are noted.
    """

    __slots__ = ("expression", "guards", "sample")

    def __init__(self, expression: Any, sample: float, guards: Guards) -> None:
        self.expression, self.sample, self.guards = expression, sample, guards

    def __repr__(self) -> str:
        return f"<Symbol, {self.sample:.6g} at the sample>"

    __hash__ = object.__hash__

    # --- what is made of it -----------------------------------------------------------------------

    def _made(self, expression: Any, sample: float) -> Any:
        if expression.is_constant():
            return float(expression)
        return Symbol(expression, sample, self.guards)

    def _unary(self, name: str, value: Callable[[float], float]) -> Any:
        return self._made(getattr(casadi, name)(self.expression), _value(value, self.sample))

    def _binary(self, name: str, other: Any, value: Callable[[float, float], float]) -> Any:
        right, sample = _parts(other)
        return self._made(getattr(casadi, name)(self.expression, right), _value(value, self.sample, sample))

    def __add__(self, other: Any) -> Any:
        right, sample = _parts(other)
        if right is None:
            return NotImplemented
        if type(right) is float and right == 0.0:
            return self
        return self._made(self.expression + right, self.sample + sample)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        right, sample = _parts(other)
        if right is None:
            return NotImplemented
        if type(right) is float and right == 0.0:
            return self
        return self._made(self.expression - right, self.sample - sample)

    def __rsub__(self, other: Any) -> Any:
        left, sample = _parts(other)
        if left is None:
            return NotImplemented
        return self._made(left - self.expression, sample - self.sample)

    def __mul__(self, other: Any) -> Any:
        right, sample = _parts(other)
        if right is None:
            return NotImplemented
        if type(right) is float:
            if right == 0.0:
                return 0.0
            if right == 1.0:
                return self
        return self._made(self.expression * right, self.sample * sample)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        right, sample = _parts(other)
        if right is None:
            return NotImplemented
        return self._made(self.expression / right, _value(_divided, self.sample, sample))

    def __rtruediv__(self, other: Any) -> Any:
        left, sample = _parts(other)
        if left is None:
            return NotImplemented
        if type(left) is float and left == 0.0:
            return 0.0
        return self._made(left / self.expression, _value(_divided, sample, self.sample))

    def __pow__(self, other: Any) -> Any:
        if isinstance(other, (int, np.integer)) or (isinstance(other, float) and other.is_integer()):
            return self._power(int(other))
        if type(other) is not Symbol and other == 0.5:
            return self.sqrt()
        return self._binary("power", other, math.pow)

    def _power(self, exponent: int) -> Any:
        if exponent < 0:
            return 1.0 / self._power(-exponent)
        result: Any = 1.0
        for _ in range(exponent):
            result = result * self
        return result

    def __rpow__(self, other: Any) -> Any:
        return (self * math.log(other)).exp()

    def __mod__(self, other: Any) -> Any:
        return self - other * (self / other).floor()

    def __neg__(self) -> Any:
        return self._made(-self.expression, -self.sample)

    def __pos__(self) -> Symbol:
        return self

    def __abs__(self) -> Any:
        return self._unary("fabs", abs)

    # --- comparisons: the sample's branch is taken --------------------------------------------------

    def __bool__(self) -> bool:
        return self.guards.take(self.expression != 0.0, self.sample != 0.0)

    def __lt__(self, other: Any) -> Any:
        return self._compared(other, lambda a, b: a < b)

    def __le__(self, other: Any) -> Any:
        return self._compared(other, lambda a, b: a <= b)

    def __gt__(self, other: Any) -> Any:
        return self._compared(other, lambda a, b: a > b)

    def __ge__(self, other: Any) -> Any:
        return self._compared(other, lambda a, b: a >= b)

    def __eq__(self, other: object) -> Any:
        return self._compared(other, lambda a, b: a == b)

    def __ne__(self, other: object) -> Any:
        return self._compared(other, lambda a, b: a != b)

    def _compared(self, other: Any, compare: Callable[[Any, Any], Any]) -> Any:
        right, sample = _parts(other)
        if right is None:
            return NotImplemented
        if type(right) is float and math.isinf(right):  # the largest number bounds all finite ones; NaN fails both
            right = math.copysign(_LARGEST, right)
        return self.guards.take(compare(self.expression, right), bool(compare(self.sample, sample)))

    # --- what cannot be -----------------------------------------------------------------------------

    def __float__(self) -> float:
        raise NotTraceableError("a number that depends on the arm's state is made a plain float here")

    def __index__(self) -> int:
        raise NotTraceableError("a number that depends on the arm's state is made an integer here")

    __int__ = __index__

    # --- functions, by the names that NumPy asks objects for ------------------------------------------

    def conjugate(self) -> Symbol:
        """Return the number itself."""
        return self

    def sqrt(self) -> Any:
        """Return √x."""
        return self._unary("sqrt", math.sqrt)

    def exp(self) -> Any:
        """Return eˣ."""
        return self._unary("exp", math.exp)

    def log(self) -> Any:
        """Return ln x."""
        return self._unary("log", math.log)

    def sin(self) -> Any:
        """Return sin x."""
        return self._unary("sin", math.sin)

    def cos(self) -> Any:
        """Return cos x."""
        return self._unary("cos", math.cos)

    def tan(self) -> Any:
        """Return tan x."""
        return self._unary("tan", math.tan)

    def arcsin(self) -> Any:
        """Return arcsin x."""
        return self._unary("asin", math.asin)

    def arccos(self) -> Any:
        """Return arccos x."""
        return self._unary("acos", math.acos)

    def arctan(self) -> Any:
        """Return arctan x."""
        return self._unary("atan", math.atan)

    def tanh(self) -> Any:
        """Return tanh x."""
        return self._unary("tanh", math.tanh)

    def floor(self) -> Any:
        """Return the largest whole number that is not above x."""
        return self._unary("floor", math.floor)

    def sign(self) -> Any:
        """Return −1, 0 or 1."""
        return self._unary("sign", lambda x: float(np.sign(x)))

    def fmod(self, other: Any) -> Any:
        """Return x − y·trunc(x/y)."""
        return self._binary("fmod", other, math.fmod)

    def arctan2(self, other: Any) -> Any:
        """Return the angle of (other, x)."""
        return self._binary("atan2", other, math.atan2)

    def hypot(self, other: Any) -> Any:
        """Return √(x² + y²); C's ``hypot`` is many times slower, and joints do not reach 1e150 rad/s."""
        return (self * self + other * other).sqrt()

    def maximum(self, other: Any) -> Any:
        """Return the larger of both."""
        return self._binary("fmax", other, max)

    def minimum(self, other: Any) -> Any:
        """Return the smaller of both."""
        return self._binary("fmin", other, min)


def _parts(other: Any) -> tuple[Any, float]:
    """Return what an operand is in expressions, and its sample; (None, nan) where it is no number."""
    if type(other) is Symbol:
        return other.expression, other.sample
    if isinstance(other, (float, int, np.floating, np.integer)):
        number = float(other)
        return number, number
    return None, math.nan


def _divided(left: float, right: float) -> float:
    return left / right


def _value(function: Callable[..., float], *samples: float) -> float:
    """Return a function of samples; NaN where it has none, as NumPy has it."""
    try:
        return float(function(*samples))
    except (ValueError, ZeroDivisionError, OverflowError):
        return math.nan


def is_symbolic(value: Any) -> bool:
    """Whether a value is a symbol or an array of objects."""
    return type(value) is Symbol or (isinstance(value, np.ndarray) and value.dtype == object)


def sample_of(value: Any) -> float:
    """Return the sample of a symbol, or a float as it is."""
    return value.sample if type(value) is Symbol else float(value)


class SymbolArray(np.ndarray):
    """An array of symbols whose largest entry is a function of all, and not a branch."""

    def max(self, axis: Any = None, initial: Any = None, **_: Any) -> Any:  # type: ignore[override]
        """Return the largest entry of all."""
        return self._reduced("maximum", axis, initial)

    def min(self, axis: Any = None, initial: Any = None, **_: Any) -> Any:  # type: ignore[override]
        """Return the smallest entry of all."""
        return self._reduced("minimum", axis, initial)

    def _reduced(self, name: str, axis: Any, initial: Any) -> Any:
        if axis is not None:
            raise NotTraceableError(f"the {name} along one axis is not traced")
        entries = self.ravel().tolist() + ([] if initial is None else [initial])
        return reduce(lambda a, b: larger(name, a, b), entries)


def larger(name: str, first: Any, second: Any) -> Any:
    """Return the "maximum" or "minimum" of two numbers, one of which may be a symbol."""
    if type(first) is Symbol:
        return getattr(first, name)(second)
    if type(second) is Symbol:
        return getattr(second, name)(first)
    return max(first, second) if name == "maximum" else min(first, second)


def symbols(values: Any) -> SymbolArray:
    """Return numbers and symbols as an array of objects."""
    return np.array(values, dtype=object).view(SymbolArray)
