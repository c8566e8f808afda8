"""A symbolic scalar that computes a sample beside, and arrays of it."""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable
from functools import reduce
from typing import Any, NoReturn

import casadi
import numpy as np

from phcontrol.compilation.errors import NotTraceableError

_LARGEST = float(np.finfo(np.float64).max)
_LEAST = 1e-150  # what may be divided by: squares of smaller numbers lose digits
_EXPONENT = 700.0  # e to more is no number

TRACING: set[int] = set()
"""The thread that traces: others that run laws meanwhile get plain arrays, as ever."""
INNER = ("phcontrol.compilation", "numpy", "scipy", "casadi")
"""Modules that are no law's: a line of the law is one outside of them."""
REFUSALS: list[NotTraceableError] = []
"""What was refused in this trace: a law that catches the error is refused all the same."""


def refuse(text: str) -> NoReturn:
    """Raise NotTraceableError, and remember it."""
    frame = sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").startswith(INNER):
        frame = frame.f_back
    file = frame.f_code.co_filename.rpartition("/")[2]
    error = NotTraceableError(f"{text} ({file}:{frame.f_lineno}, in {frame.f_code.co_name})")
    REFUSALS.append(error)
    raise error


def plain_terms() -> None:
    """Let CasADi write down what a law computes as it stands: x/x is not 1 at x = 0, log eˣ not x where eˣ is none."""
    casadi.GlobalOptions.setSimplificationOnTheFly(False)


plain_terms()


class Guards:
    """The conditions under which a trace is right: each an expression, and what it was when the trace was made."""

    def __init__(self) -> None:
        self._found: dict[tuple[int, bool], Any] = {}
        self._bounded: dict[tuple[int, str], Any] = {}
        self.blocks: list[Any] = []
        """Decompositions into eigenvalues, in the order in which they were asked for."""
        self.expressions: list[Any] = []
        """Of branches: all 1 where they go the trace's way."""
        self.bounds: list[Any] = []
        """Of quotients, roots and the like: all 1 where they are finite numbers."""

    @property
    def conditions(self) -> list[Any]:
        """Expressions that are all 1 where the trace is right."""
        return [*self.expressions, *self.bounds]

    def take(self, condition: Any, sample: bool) -> bool:
        """Take the sample's branch of an ``if``, and note its condition."""
        if condition.is_constant():
            return bool(float(condition))
        key = condition.element_hash(), sample
        if key not in self._found:
            self._found[key] = condition  # kept alive: its hash is its address
            self.expressions.append(condition if sample else casadi.logic_not(condition))
        return sample

    def require(self, expression: Any, kind: str) -> None:
        """Note that an expression must be "finite", "divisor", "positive", "not negative", "sine" or "exponent".

        Elsewhere floats raise an error, or become inf or NaN, which maxima, comparisons and quotients would swallow:
        there the interpreted law answers.
        """
        expression = casadi.SX(expression)
        if expression.is_symbolic() and kind == "finite":
            return  # the border lets no others in
        key = expression.element_hash(), kind
        if key in self._bounded:
            return
        self._bounded[key] = expression  # kept alive, as above
        size = casadi.fabs(expression)
        conditions = {
            "finite": lambda: [size <= _LARGEST],
            "divisor": lambda: [size > _LEAST, size <= _LARGEST],
            "positive": lambda: [expression > 0.0],
            "not negative": lambda: [expression >= 0.0],
            "sine": lambda: [size <= 1.0],
            "exponent": lambda: [expression <= _EXPONENT, expression >= -_LARGEST],
        }[kind]()
        for condition in conditions:
            if not (condition.is_constant() and bool(float(condition))):
                self.bounds.append(condition)


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
        if threading.get_ident() in TRACING:
            refuse("a number that depends on the arm's state is made a text here")
        return f"<Symbol, {self.sample:.6g} at the sample>"

    def __str__(self) -> str:
        return repr(self)

    def __format__(self, form: str) -> str:
        return repr(self)

    def __hash__(self) -> int:
        refuse("a number that depends on the arm's state is looked up here, in a dict or a set")

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_"):  # NumPy asks objects for its functions by name
            refuse(f"{name} of a number that depends on the arm's state is not traced")
        raise AttributeError(name)

    # --- what is made of it -----------------------------------------------------------------------

    def _made(self, expression: Any, sample: float) -> Any:
        if expression.is_constant():
            return float(expression)
        return Symbol(expression, sample, self.guards)

    def _unary(self, name: str, value: Callable[[float], float], argument: str = "") -> Any:
        if argument:
            self.guards.require(self.expression, argument)
        return self._made(getattr(casadi, name)(self.expression), _value(value, self.sample))

    def _binary(self, name: str, other: Any, value: Callable[[float, float], float]) -> Any:
        right, sample = _parts(other)
        if right is None:
            refuse(f"{name} of a number and of {type(other).__name__} is not traced")
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
        if type(left) is float and left == 0.0:  # by a zero's sign nothing differs but atan2, which looks
            return -self
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
            if right == -1.0:
                return -self
        return self._made(self.expression * right, self.sample * sample)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        right, sample = _parts(other)
        if right is None:
            return NotImplemented
        self.guards.require(right, "divisor")
        return self._made(self.expression / right, _value(_divided, self.sample, sample))

    def __rtruediv__(self, other: Any) -> Any:
        left, sample = _parts(other)
        if left is None:
            return NotImplemented
        self.guards.require(self.expression, "divisor")
        if type(left) is float and left == 0.0:
            return 0.0
        return self._made(left / self.expression, _value(_divided, sample, self.sample))

    def __pow__(self, other: Any) -> Any:
        right, _ = _parts(other)
        if right is None:
            return NotImplemented
        if type(right) is float and right.is_integer():
            return self._finite(self._power(int(right)))
        if type(right) is float and right == 0.5:
            return self.sqrt()
        if type(right) is float and right == 0.25:
            return self._finite(self.sqrt().sqrt())
        self.guards.require(self.expression, "positive")
        return self._finite(self._binary("power", other, math.pow))

    def _finite(self, result: Any) -> Any:
        """Return a result that must be finite: of floats a larger one is an error."""
        if type(result) is Symbol:
            self.guards.require(result.expression, "finite")
        return result

    def _power(self, exponent: int) -> Any:
        if exponent < 0:
            return 1.0 / self._power(-exponent)
        result: Any = 1.0
        for _ in range(exponent):
            result = result * self
        return result

    def __rpow__(self, other: Any) -> Any:
        left, _ = _parts(other)
        if left is None:
            return NotImplemented
        if not left > 0.0:
            refuse("a power of a number that is not positive is not traced")
        return (self * math.log(left)).exp()

    def __mod__(self, other: Any) -> Any:
        """Return Python's remainder: fmod, moved by the divisor where their signs differ."""
        right, sample = _parts(other)
        if right is None:
            return NotImplemented
        self.guards.require(right, "divisor")
        self.guards.require(self.expression, "finite")
        rest, by = casadi.fmod(self.expression, right), casadi.SX(right)
        other_side = casadi.logic_and(rest != 0.0, (rest < 0.0) != (by < 0.0))
        return self._made(rest + other_side * by, _value(lambda a, b: a % b, self.sample, sample))

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
        return self.guards.take(compare(self.expression, right), bool(compare(self.sample, sample)))

    # --- what cannot be -----------------------------------------------------------------------------

    def __float__(self) -> float:
        refuse("a number that depends on the arm's state is made a plain float here")

    def __index__(self) -> int:
        refuse("a number that depends on the arm's state is made an integer here")

    __int__ = __trunc__ = __floor__ = __ceil__ = __index__

    def __round__(self, digits: int | None = None) -> int:
        refuse("a number that depends on the arm's state is rounded here")

    def __complex__(self) -> complex:
        refuse("a number that depends on the arm's state is made complex here")

    def _divided_whole(self, other: Any) -> NoReturn:
        refuse("whole quotients and remainders of numbers are not traced")

    __floordiv__ = __rfloordiv__ = __divmod__ = __rdivmod__ = __rmod__ = _divided_whole

    # --- what is asked of floats ----------------------------------------------------------------------

    def isfinite(self) -> bool:
        """Return whether x is finite at the sample; guarded."""
        return self.guards.take(casadi.fabs(self.expression) <= _LARGEST, math.isfinite(self.sample))

    def isnan(self) -> bool:
        """Return whether x is NaN at the sample; guarded."""
        return self.guards.take(self.expression != self.expression, math.isnan(self.sample))

    def isinf(self) -> bool:
        """Return whether x is infinite at the sample; guarded."""
        return self.guards.take(casadi.fabs(self.expression) > _LARGEST, math.isinf(self.sample))

    # --- functions, by the names that NumPy asks objects for ------------------------------------------

    def conjugate(self) -> Symbol:
        """Return the number itself."""
        return self

    def sqrt(self) -> Any:
        """Return √x."""
        return self._unary("sqrt", math.sqrt, "not negative")

    def exp(self) -> Any:
        """Return eˣ."""
        return self._unary("exp", math.exp, "exponent")

    def log(self) -> Any:
        """Return ln x."""
        return self._unary("log", math.log, "positive")

    def sin(self) -> Any:
        """Return sin x."""
        return self._unary("sin", math.sin, "finite")

    def cos(self) -> Any:
        """Return cos x."""
        return self._unary("cos", math.cos, "finite")

    def tan(self) -> Any:
        """Return tan x."""
        return self._unary("tan", math.tan, "finite")

    def arcsin(self) -> Any:
        """Return arcsin x."""
        return self._unary("asin", math.asin, "sine")

    def arccos(self) -> Any:
        """Return arccos x."""
        return self._unary("acos", math.acos, "sine")

    def arctan(self) -> Any:
        """Return arctan x."""
        return self._unary("atan", math.atan, "finite")

    def tanh(self) -> Any:
        """Return tanh x."""
        return self._unary("tanh", math.tanh, "finite")

    def floor(self) -> Any:
        """Return the largest whole number that is not above x."""
        return self._unary("floor", math.floor, "finite")

    def sign(self) -> Any:
        """Return −1, 0 or 1."""
        return self._unary("sign", lambda x: float(np.sign(x)), "finite")

    def fmod(self, other: Any) -> Any:
        """Return x − y·trunc(x/y)."""
        right, _ = _parts(other)
        if right is not None:
            self.guards.require(right, "divisor")
        self.guards.require(self.expression, "finite")
        return self._binary("fmod", other, math.fmod)

    def arctan2(self, other: Any) -> Any:
        """Return the angle of (other, x); where that is ±π by the sign of a zero, it is not for C to say."""
        right, _ = _parts(other)
        if right is not None:
            self.guards.require(self.expression, "finite")
            self.guards.require(right, "finite")
            beside = casadi.logic_or(self.expression != 0.0, casadi.SX(right) > 0.0)
            self.guards.require(-casadi.logic_not(beside), "not negative")
        return self._binary("atan2", other, math.atan2)

    def hypot(self, other: Any) -> Any:
        """Return √(x² + y²); C's ``hypot`` is many times slower, and joints do not reach 1e150 rad/s."""
        return (self * self + other * other).sqrt()

    def maximum(self, other: Any) -> Any:
        """Return the larger of both."""
        return self._of_two_numbers("fmax", other, max)

    def minimum(self, other: Any) -> Any:
        """Return the smaller of both."""
        return self._of_two_numbers("fmin", other, min)

    def exceeds(self, least: float) -> Any:
        """Return 1 where x is larger than a number, else 0."""
        self.guards.require(self.expression, "finite")
        return self._made(self.expression > least, float(self.sample > least))

    def _of_two_numbers(self, name: str, other: Any, value: Callable[[float, float], float]) -> Any:
        """Return C's maximum or minimum, which swallow NaN: both must be numbers."""
        right, _ = _parts(other)
        self.guards.require(self.expression, "finite")
        if type(right) is float and math.isnan(right):
            return right
        if type(other) is Symbol:
            self.guards.require(right, "finite")
        return self._binary(name, other, value)


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

    def max(self, axis: Any = None, out: Any = None, initial: Any = None, **options: Any) -> Any:
        """Return the largest entry of all."""
        return self._reduced("maximum", axis, out, initial, options)

    def min(self, axis: Any = None, out: Any = None, initial: Any = None, **options: Any) -> Any:
        """Return the smallest entry of all."""
        return self._reduced("minimum", axis, out, initial, options)

    def astype(self, dtype: Any, *rest: Any, **options: Any) -> Any:
        """Return a copy: symbols are floats."""
        if not is_real(dtype):
            refuse("numbers that depend on the arm's state are made other ones than floats here")
        return self.copy()

    def _reduced(self, name: str, axis: Any, out: Any, initial: Any, options: dict[str, Any]) -> Any:
        if axis is not None or out is not None or options:
            refuse(f"the {name} of some entries, or along one axis, is not traced")
        entries = self.ravel().tolist() + ([] if initial is None else [initial])
        return reduce(lambda a, b: larger(name, a, b), entries)


def larger(name: str, first: Any, second: Any) -> Any:
    """Return the "maximum" or "minimum" of two numbers, one of which may be a symbol."""
    if type(first) is Symbol:
        return getattr(first, name)(second)
    if type(second) is Symbol:
        return getattr(second, name)(first)
    return max(first, second) if name == "maximum" else min(first, second)


def is_real(dtype: Any) -> bool:
    """Whether a type of numbers is one that symbols stand for: none named, double precision, or objects."""
    try:
        return dtype is None or np.dtype(dtype) in (np.dtype(np.float64), np.dtype(object))
    except TypeError:
        return False


def symbols(values: Any) -> SymbolArray:
    """Return numbers and symbols as an array of objects."""
    return np.array(values, dtype=object).view(SymbolArray)
