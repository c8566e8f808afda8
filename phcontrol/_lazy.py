"""A quantity computed on first use and once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

Value = TypeVar("Value")


class lazy(Generic[Value]):  # noqa: N801 - reads as a decorator
    """``functools.cached_property`` without the lock that Python 3.10 and 3.11 put around it.

    The value goes into the instance's ``__dict__``, so that later reads cost a plain attribute look-up.
    """

    def __init__(self, compute: Callable[[Any], Value]) -> None:
        self.compute = compute
        self.name = compute.__name__
        self.__doc__ = compute.__doc__

    @overload
    def __get__(self, instance: None, owner: type) -> lazy[Value]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> Value: ...
    def __get__(self, instance: object | None, owner: type) -> lazy[Value] | Value:
        if instance is None:
            return self
        value = instance.__dict__[self.name] = self.compute(instance)
        return value


if not TYPE_CHECKING:
    with suppress(ImportError):  # the same in C, where it was built: it is on the way of every control step
        from phcontrol._lazy_compiled import lazy
