"""The numbers of a law that a compiled function takes as inputs: gains, goals, tables of references."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.compilation.rigid_body import ArmModel
from phcontrol.compilation.symbol import symbols
from phcontrol.compilation.tracing import holds_state
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

_LEFT_ALONE = ("_given", "_found", "parameters")


def _plain(thing: Any) -> Any:
    """Return the interpreted law of a compiled one, as a schedule may hold it."""
    interpreted = getattr(thing, "interpreted", None) if isinstance(thing, Controller) else None
    return thing if interpreted is None else interpreted


def _left_alone(thing: Any, name: str) -> bool:
    """Whether an attribute is not looked into: what was given, and what is computed on first use."""
    return name in _LEFT_ALONE or isinstance(getattr(type(thing), name, None), lazy)


def law_numbers(law: Controller, inertias: bool = False) -> Array:
    """Return every number that ``with_inputs`` makes an input, in its order, shape (m,); those of the arm's after them.

    Args:
        law: the law.
        inertias: whether the inertias of the arm are inputs too.
    """
    found: list[float] = []

    def keep(values: list[float]) -> list[Any]:
        found.extend(values)
        return list(values)

    with_inputs(law, law.system, keep)
    if inertias:
        found += ArmModel(law.system.model).inertial_numbers()
    return np.array(found, dtype=np.float64)


def with_inputs(law: Controller, system: Any, make: Callable[[list[float]], list[Any]]) -> Controller:
    """Return a copy of a law that computes with another system, in whose arrays numbers are replaced.

    Arrays of the law and of what it holds (potential, reference, laws of a schedule) are gone through in order, each
    once. What is 0 in a matrix stays 0, so that sparse gains stay cheap; single floats, flags and texts stay as they
    are.

    Args:
        law: the law.
        system: takes the place of its model.
        make: returns what replaces the numbers of one array.
    """
    made: dict[int, Any] = {}
    kept: list[Any] = []

    def turned(thing: Any) -> Any:
        thing = _plain(thing)
        if id(thing) in made:
            return made[id(thing)]
        result = _turned(thing)
        made[id(thing)] = result
        kept.append(thing)  # so that no other thing gets its id
        return result

    def _turned(thing: Any) -> Any:
        if isinstance(thing, MechanicalSystem):
            return system if thing is law.system else thing
        if isinstance(thing, np.ndarray):
            return _replaced(thing, make)
        if isinstance(thing, tuple):
            parts = [turned(part) for part in thing]
            return type(thing)(*parts) if hasattr(thing, "_fields") else tuple(parts)
        if isinstance(thing, list):
            return [turned(part) for part in thing]
        if isinstance(thing, dict):
            return {key: turned(part) for key, part in thing.items()}
        if isinstance(thing, functools.partial):
            return functools.partial(thing.func, *turned(thing.args), **turned(thing.keywords))
        if not holds_state(thing):
            return thing
        twin = copy.copy(thing)
        made[id(thing)] = twin  # before its parts: they may hold it
        for name in [name for name in vars(thing) if isinstance(getattr(type(thing), name, None), lazy)]:
            del twin.__dict__[name]
        for name, part in vars(thing).items():
            if not _left_alone(thing, name):
                twin.__dict__[name] = turned(part)
        return twin

    result: Controller = turned(law)
    return result


def _replaced(array: Any, make: Callable[[list[float]], list[Any]]) -> Any:
    if array.dtype != np.float64:
        return array
    flat, places = array.ravel(), _places(array)
    if not places.size:
        return array
    new = make([float(value) for value in flat[places]])
    if all(isinstance(value, float) for value in new):
        return array
    entries = symbols(flat)
    entries[places] = new
    return entries.reshape(array.shape)


def _places(array: Any) -> Any:
    """Return where in an array, flattened, inputs are: everywhere in a vector, elsewhere where it is not 0."""
    return np.arange(array.size) if array.ndim == 1 else np.flatnonzero(array)


def structure_of(law: Controller, inertias: bool = False) -> list[Any]:
    """Return all of a law, and of its arm, that is code and no input: two laws with the same need one compilation."""
    found: list[Any] = []
    seen: dict[int, int] = {}
    kept: list[Any] = []

    def look(thing: Any) -> None:
        thing = _plain(thing)
        if isinstance(thing, (bool, int, float, str, type(None))):
            found.append(repr(thing))
            return
        if id(thing) in seen:
            found.append(seen[id(thing)])
            return
        seen[id(thing)] = len(seen)
        kept.append(thing)
        found.append(type(thing))
        if isinstance(thing, np.ndarray):
            found.append((thing.shape, _places(thing).tobytes()))
            found.append(b"" if thing.dtype == np.float64 else thing.tobytes())
        elif isinstance(thing, (tuple, list)):
            for part in thing:
                look(part)
        elif isinstance(thing, dict):
            for key, part in thing.items():
                found.append(key)
                look(part)
        elif isinstance(thing, functools.partial):
            for part in (thing.func, thing.args, thing.keywords):
                look(part)
        elif isinstance(thing, MechanicalSystem):
            found.extend(ArmModel(thing.model).structure(inertias))
            for part in (thing.friction, thing.potentials, thing.coupling, thing.robot.continuous, thing.input_matrix):
                look_exactly(part)
        elif not holds_state(thing):
            found.append(id(thing))
        else:
            for name, part in vars(thing).items():
                if not _left_alone(thing, name):
                    found.append(name)
                    look(part)

    def look_exactly(thing: Any) -> None:
        """Look at what belongs to the plant: its numbers are code."""
        if isinstance(thing, np.ndarray):
            found.append((thing.shape, thing.tobytes()))
        elif isinstance(thing, tuple):
            for part in thing:
                look_exactly(part)
        elif hasattr(thing, "__dict__") and not callable(thing):
            found.append(type(thing))
            for name, part in vars(thing).items():
                found.append(name)
                look_exactly(part)
        else:
            found.append(repr(thing))

    look(law)
    return found
