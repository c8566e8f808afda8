"""What a compiled law was compiled from, watched: numbers that are changed afterwards are noticed."""

from __future__ import annotations

import functools
import random
import types
from collections.abc import Iterator
from typing import Any

import numpy as np

from phcontrol.compilation.errors import NotTraceableError
from phcontrol.compilation.law_inputs import _left_alone
from phcontrol.compilation.there import there
from phcontrol.compilation.tracing import classes_of, holds_state
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

_OWN = "phcontrol."
_PLANT = ("friction", "potentials", "input_matrix", "coupling", "model")
_CLOCKS = ("time", "datetime", "random", "secrets", "uuid")
_DICE = (np.random.Generator, np.random.RandomState, np.random.BitGenerator, random.Random)
_NUMBERS = (bool, int, float, str, tuple, list, dict, np.ndarray, np.generic)


class Watch:
    """What of a law, and of what it holds, must stay as it was when it was compiled.

    Attributes by their identities, which is cheap to look at; arrays that can be written into, lists and dicts by what
    is in them; and what the law's own functions read beside: closures, globals and attributes of classes, where they
    are numbers. Not seen are ``__slots__``, what other functions read, and a ``pin.Model`` that is changed in place.

    Args:
        laws: the interpreted law, and the compiled one, which has the same attributes.
    """

    def __init__(self, *laws: Controller) -> None:
        self.dicts: list[tuple[dict[Any, Any], tuple[Any, ...], tuple[Any, ...]]] = []
        """Dicts, with keys in their order, and what they had."""
        self.lists: list[tuple[list[Any], tuple[Any, ...]]] = []
        """Lists, and what was in them."""
        self.arrays: list[tuple[Any, Any]] = []
        """Arrays that can be written into, and copies of them."""
        self.others: list[tuple[Any, str, Any]] = []
        """Cells of closures, dicts of globals and classes, a name, and what was there."""
        self._seen: dict[int, Any] = {}
        for law in laws:
            self._hold(law)
        for where, name, value in read_beside(laws[0]):
            if isinstance(value, _NUMBERS):
                self.others.append((where, name, value))
                self._hold(value)

    def _hold(self, thing: Any) -> None:
        if id(thing) in self._seen:
            return
        self._seen[id(thing)] = thing
        if isinstance(thing, np.ndarray):
            if thing.flags.writeable and thing.dtype != object:
                self.arrays += [(part, part.copy()) for part in _contiguous(thing)]
        elif isinstance(thing, MechanicalSystem):
            self._hold_dict(vars(thing), [name for name in vars(thing) if name in _PLANT])
        elif isinstance(thing, tuple):
            for part in thing:
                self._hold(part)
        elif isinstance(thing, list):
            self.lists.append((thing, tuple(thing)))
            for part in thing:
                self._hold(part)
        elif isinstance(thing, dict):
            self._hold_dict(thing, list(thing))
        elif isinstance(thing, functools.partial):
            self._hold(thing.args)
            self._hold(thing.keywords)
        elif holds_state(thing):
            self._hold_dict(vars(thing), [name for name in vars(thing) if not _left_alone(thing, name)])

    def _hold_dict(self, found: dict[Any, Any], names: list[Any]) -> None:
        self.dicts.append((found, tuple(names), tuple(found[name] for name in names)))
        for name in names:
            self._hold(found[name])

    def changed(self) -> str:
        """Return the name of something that is not what it was, "" where all is."""
        for found, names, values in self.dicts:
            for name, value in zip(names, values, strict=True):
                if not _same(found.get(name), value):
                    return str(name)
        for entries, values in self.lists:
            if len(entries) != len(values) or not all(map(_same, entries, values)):
                return "a list"
        for array, copy in self.arrays:
            if not np.array_equal(array, copy, equal_nan=array.dtype.kind in "fc"):
                return f"an array of shape {array.shape}"
        for where, name, value in self.others:
            if not _same(there(where, name), value):
                return name
        return ""


def _contiguous(array: Any) -> list[Any]:
    """Return views that show all of an array, each of numbers side by side."""
    if array.flags.c_contiguous:
        return [array]
    if array.flags.f_contiguous:
        return [array.T]
    return [view for k in range(len(array)) for view in _contiguous(array[k : k + 1] if array.ndim == 1 else array[k])]


def _same(one: Any, other: Any) -> bool:
    return one is other or (type(one) is type(other) and isinstance(one, (bool, int, float, str)) and one == other)


def read_beside(law: Any) -> Iterator[tuple[Any, str, Any]]:
    """Yield what functions that are not phcontrol's, of a law or of what it holds, read beside their arguments.

    Each as a cell, a dict of globals or a class, the name there, and what is there.
    """
    for kind in classes_of(law):
        if kind.__module__.startswith(_OWN):
            continue
        for name, value in vars(kind).items():
            function = _function(value)
            if function is not None:
                yield from _read_by(function)
            elif not name.startswith("__") and isinstance(value, _NUMBERS):
                yield kind, name, value
    for function in _held_functions(law):
        yield from _read_by(function)


def _function(value: Any) -> types.FunctionType | None:
    """Return the function of a method, a property or a lazy attribute; None of anything else."""
    for name in ("__func__", "fget", "compute", "func"):
        value = getattr(value, name, None) or value
    return value if isinstance(value, types.FunctionType) else None


def _held_functions(law: Any) -> Iterator[types.FunctionType]:
    """Yield the functions that a law, or what it holds, has as attributes."""
    seen: set[int] = set()
    waiting: list[Any] = [law]
    while waiting:
        thing = waiting.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        function = _function(thing)
        if function is not None:
            if not function.__module__.startswith(_OWN):
                yield function
        elif isinstance(thing, (tuple, list)):
            waiting.extend(thing)
        elif isinstance(thing, dict):
            waiting.extend(thing.values())
        elif isinstance(thing, functools.partial):
            waiting.extend([*thing.args, *thing.keywords.values()])
        elif holds_state(thing):
            waiting.extend(part for name, part in vars(thing).items() if not _left_alone(thing, name))


def _read_by(function: types.FunctionType) -> Iterator[tuple[Any, str, Any]]:
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield cell, name, there(cell, name)
    for code in _codes(function.__code__):
        for name in code.co_names:
            if name in function.__globals__:
                yield function.__globals__, name, function.__globals__[name]


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yield a code object and those inside it."""
    yield code
    for part in code.co_consts:
        if isinstance(part, types.CodeType):
            yield from _codes(part)


def refuse_clocks_and_dice(thing: Any, title: str) -> None:
    """Raise NotTraceableError where functions of a law, or of something else, read a clock or a random generator.

    Args:
        thing: the law, bodies, disturbances.
        title: what to call it.
    """
    for _, name, value in read_beside(thing):
        module = value.__name__ if isinstance(value, types.ModuleType) else getattr(value, "__module__", None)
        if (
            isinstance(value, _DICE)
            or isinstance(getattr(value, "__self__", None), _DICE)
            or ((isinstance(value, types.ModuleType) or callable(value)) and str(module).partition(".")[0] in _CLOCKS)
        ):
            raise NotTraceableError(
                f"{title} cannot be compiled: it reads '{name}', a clock or a random generator; what differs from "
                "call to call must be measured, or in the law's state"
            )
