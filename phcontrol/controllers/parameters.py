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

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, Parameter, load_robot
        >>> class Named(EnergyShaping):
        ...     name = "named"
        ...     label = Parameter("", "", default="arm", check=lambda name, value, system: str(value))
        >>> Named.tuned(MechanicalSystem(load_robot("pera_gripper")), label=7).label
        '7'
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
    """A symmetric positive-definite (n, n) matrix, given as scalar, vector or matrix.

    Example:
        >>> from phcontrol import EnergyShaping, Gain, MechanicalSystem, load_robot
        >>> class Spring(EnergyShaping):
        ...     name = "spring"
        ...     extra: Gain = Gain("K_x", "N·m/rad", default=1.0)
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> Spring.tuned(system, extra=[2.0, 3.0]).extra  # a vector is a diagonal
        array([[2., 0.],
               [0., 3.]])
    """

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Array:
        """Return the matrix."""
        return _validation.gain(name, value, system.n)


class Matrix(Parameter[ArrayLike, Array]):
    """Any (n, n) matrix, given as scalar, vector or matrix.

    Example:
        >>> from phcontrol import Matrix, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> Matrix("A").checked("coupling", 0.5, system)  # a number is that of a diagonal
        array([[0.5, 0. ],
               [0. , 0.5]])
    """

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Array:
        """Return the matrix."""
        return _validation.matrix(name, value, system.n)


class Vector(Parameter[ArrayLike, Array]):
    """One number for each joint.

    Example:
        >>> from phcontrol import MechanicalSystem, Vector, load_robot
        >>> Vector("q_d", "rad").checked("goal", [0.1, 0.2], MechanicalSystem(load_robot("pera_shoulder")))
        array([0.1, 0.2])
    """

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Array:
        """Return the vector."""
        return _validation.vector(name, value, system.n)


class PositiveVector(Parameter[ArrayLike, Array]):
    """A number above zero for each joint; a scalar stands for all.

    Example:
        >>> from phcontrol import MechanicalSystem, PositiveVector, load_robot
        >>> PositiveVector("v", "rad/s").checked("speed", 0.5, MechanicalSystem(load_robot("pera_shoulder")))
        array([0.5, 0.5])
    """

    def check(self, name: str, value: Any, system: MechanicalSystem) -> Array:
        """Return the vector."""
        return _validation.positive_vector(name, value, system.n)


class Positive(Parameter[float, float]):
    """A number above zero.

    Example:
        >>> from phcontrol import MechanicalSystem, Positive, load_robot
        >>> Positive("κ", "1/s").checked("rate", 2, MechanicalSystem(load_robot("pera_gripper")))
        2.0
    """

    def check(self, name: str, value: Any, system: MechanicalSystem) -> float:
        """Return the number."""
        return _validation.positive(name, value)


class NonNegative(Parameter[float, float]):
    """A number that is not below zero.

    Example:
        >>> from phcontrol import InvalidArgumentError, MechanicalSystem, NonNegative, load_robot
        >>> try:
        ...     NonNegative("k").checked("rate", -1.0, MechanicalSystem(load_robot("pera_gripper")))
        ... except InvalidArgumentError as error:
        ...     print(error)
        rate: must be >= 0, but is -1
    """

    def check(self, name: str, value: Any, system: MechanicalSystem) -> float:
        """Return the number."""
        return _validation.number(name, value, minimum=0.0)


class Flag(Parameter[bool, bool]):
    """True or False.

    Example:
        >>> from phcontrol import Flag
        >>> Flag("", default=False).default
        False
    """

    def check(self, name: str, value: Any, system: MechanicalSystem) -> bool:
        """Return the flag."""
        return _validation.flag(name, value)
