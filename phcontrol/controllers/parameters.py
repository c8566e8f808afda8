"""How a law declares its arguments: once, with symbol, unit, check and default."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

from numpy.typing import ArrayLike

from phcontrol import _validation
from phcontrol._validation import Array
from phcontrol.controllers.tuning import Tuning
from phcontrol.mechanics.system import MechanicalSystem

REQUIRED: Any = object()
"""The default of a parameter that has none."""

Given = TypeVar("Given")
Kept = TypeVar("Kept")


class Parameter(Generic[Given, Kept]):
    """One keyword argument of a law. The law keeps what ``check`` makes of what is given, under the same name.

    Args:
        symbol: in the law's formulas.
        unit: of the value.
        default: of the constructor; without one the argument must be given. None stands for "not used" and is kept.
        tuned: makes the value that suits a robot (``Controller.tuned``).
        check: (name, value, system) -> value, or raises InvalidArgumentError.
    """

    def __init__(
        self,
        symbol: str = "",
        unit: str = "",
        *,
        default: Any = REQUIRED,
        tuned: Callable[[Tuning], Any] | None = None,
        check: Callable[[str, Any, MechanicalSystem], Kept] | None = None,
    ) -> None:
        self.symbol, self.unit, self.default, self.tuned = symbol, unit, default, tuned
        self._check = check

    def checked(self, name: str, value: Any, system: MechanicalSystem) -> Any:
        """Return what the law keeps of a value."""
        if value is None and self.default is None:
            return None
        return self.check(name, value, system)

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Kept:
        """Return a value as it should be. Raises InvalidArgumentError when it is not."""
        assert self._check is not None
        return self._check(name, value, system)

    if TYPE_CHECKING:  # a type checker sees arguments of the constructor; a law holds plain attributes

        @overload
        def __get__(self, law: None, owner: type) -> Parameter[Given, Kept]: ...
        @overload
        def __get__(self, law: object, owner: type) -> Kept: ...
        def __get__(self, law: object | None, owner: type) -> Parameter[Given, Kept] | Kept: ...
        def __set__(self, law: object, value: Given) -> None: ...


class Gain(Parameter[ArrayLike, Array]):
    """A symmetric positive-definite (n, n) matrix, given as scalar, vector or matrix."""

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Array:
        """Return the matrix."""
        return _validation.gain(name, value, system.n)


class Matrix(Parameter[ArrayLike, Array]):
    """Any (n, n) matrix, given as scalar, vector or matrix."""

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Array:
        """Return the matrix."""
        return _validation.matrix(name, value, system.n)


class Vector(Parameter[ArrayLike, Array]):
    """One number for each joint."""

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Array:
        """Return the vector."""
        return _validation.vector(name, value, system.n)


class PositiveVector(Parameter[ArrayLike, Array]):
    """A number above zero for each joint; a scalar stands for all."""

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Array:
        """Return the vector."""
        return _validation.positive_vector(name, value, system.n)


class Positive(Parameter[float, float]):
    """A number above zero."""

    def check(self, name: str, value: Any, system: MechanicalSystem) -> float:
        """Return the number."""
        return _validation.positive(name, value)


class NonNegative(Parameter[float, float]):
    """A number that is not below zero."""

    def check(self, name: str, value: Any, system: MechanicalSystem) -> float:
        """Return the number."""
        return _validation.number(name, value, minimum=0.0)


class Flag(Parameter[bool, bool]):
    """True or False."""

    def check(self, name: str, value: Any, system: MechanicalSystem) -> bool:
        """Return the flag."""
        return _validation.flag(name, value)
