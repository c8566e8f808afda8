"""A constructor made of declarations."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, ClassVar

from phcontrol.controllers.parameters import (
    REQUIRED,
    Flag,
    Gain,
    Matrix,
    NonNegative,
    Parameter,
    Positive,
    PositiveVector,
    Vector,
)
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem, check_system

if TYPE_CHECKING:
    from typing_extensions import Self, dataclass_transform
else:

    def dataclass_transform(**_: Any) -> Any:
        """Do nothing: it speaks to type checkers (PEP 681)."""
        return lambda cls: cls


class Plant(Parameter[MechanicalSystem, MechanicalSystem]):
    """The first argument of every law: the model that it computes with."""

    def __init__(self, *, kw_only: bool = False) -> None:
        super().__init__("the model of the arm")


@dataclass_transform(
    kw_only_default=True,
    field_specifiers=(Parameter, Gain, Matrix, Vector, Positive, PositiveVector, NonNegative, Flag, Plant),
)
class Declared:
    """Base of what is made from a system and declared keyword arguments.

    Each :class:`Parameter` of a class becomes a keyword argument of its constructor, and an attribute of what is made.
    After all of them are checked ``prepare`` is called, for what depends on more than one of them.
    """

    parameters: ClassVar[dict[str, Parameter[Any, Any]]] = {}
    """Every argument but the system, by name."""
    _own_parameters: ClassVar[dict[str, Parameter[Any, Any]]] = {}

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        own = {name: value for name, value in vars(cls).items() if isinstance(value, Parameter)}
        for name in own:
            delattr(cls, name)  # what is made holds a plain attribute of that name
        cls._own_parameters = {name: value for name, value in own.items() if not isinstance(value, Plant)}
        cls.parameters = {}
        for base in reversed(cls.__mro__):
            cls.parameters |= vars(base).get("_own_parameters", {})
        if "__init__" not in vars(cls):
            cls.__signature__ = _signature(cls.parameters)  # type: ignore[attr-defined]

    def __init__(self, system: MechanicalSystem, **arguments: Any) -> None:
        check_system(system)
        self.system = system
        given = _signature(self.parameters).bind(system, **arguments)
        self._given = arguments
        given.apply_defaults()
        for name, parameter in self.parameters.items():
            setattr(self, name, parameter.checked(name, given.arguments[name], system))
        self.prepare()
        self._made = True

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to change an argument of what is made: what was computed of it would not follow."""
        if name in self.parameters and "_made" in self.__dict__:
            raise InvalidArgumentError(name, f"is fixed when {type(self).__name__} is made: make another by changed(…)")
        super().__setattr__(name, value)

    def changed(self, **arguments: Any) -> Self:
        """Return another of the same kind, with these arguments in place of those that it was made with.

        Raises what its constructor raises.
        """
        return type(self)(self.system, **(self._given | arguments))

    def prepare(self) -> None:
        """Check what depends on several arguments, and compute what all calls use."""


def _signature(parameters: dict[str, Parameter[Any, Any]]) -> inspect.Signature:
    system = inspect.Parameter("system", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    arguments = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if parameter.default is REQUIRED else parameter.default,
        )
        for name, parameter in parameters.items()
    ]
    return inspect.Signature([system, *arguments])
