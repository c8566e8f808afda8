"""The numbers of a law that a compiled function takes as inputs: gains, goals, tables of references."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
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
_REMEMBERED = 1024  # answers
_PER_BODY = 10  # numbers of an inertia

Bodies = frozenset[int]
"""Bodies of an arm, by their joints' places in the model, whose inertias are inputs."""
NO_BODIES: Bodies = frozenset()
Make = Callable[[list[float]], list[Any]]
"""Returns what replaces some numbers: symbols, or they themselves."""


def _plain(thing: Any) -> Any:
    """Return the interpreted law of a compiled one, as a schedule may hold it."""
    interpreted = getattr(thing, "interpreted", None) if isinstance(thing, Controller) else None
    return thing if interpreted is None else interpreted


class _Same:
    """Equal to the same thing only, which it keeps alive: by its id alone another could be taken for it."""

    def __init__(self, thing: Any) -> None:
        self.thing = thing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.thing is self.thing

    __hash__ = object.__hash__


def _left_alone(thing: Any, name: str) -> bool:
    """Whether an attribute is not looked into: what was given, and what is computed on first use."""
    return name in _LEFT_ALONE or isinstance(getattr(type(thing), name, None), lazy)


_MEMORY: ContextVar[dict[Any, Any] | None] = ContextVar("memory", default=None)


@contextmanager
def remembering() -> Iterator[None]:
    """Look at each law and each arm once meanwhile: they must not be changed in place."""
    token = _MEMORY.set({})
    try:
        yield
    finally:
        _MEMORY.reset(token)


Question = Callable[[Any, Bodies], Any]


def _remembered(ask: Question) -> Any:
    """Return a function of a law or an arm, and the bodies whose inertias are inputs, that is asked once."""

    @functools.wraps(ask)
    def asked(thing: Any, inertias: Bodies = NO_BODIES) -> Any:
        memory = _MEMORY.get()
        if memory is None:
            return ask(thing, inertias)
        key = ask, id(thing), inertias
        if key not in memory:
            if len(memory) >= _REMEMBERED:
                del memory[next(iter(memory))]
            memory[key] = ask(thing, inertias), thing  # kept alive: by its id it is known
        return memory[key][0]

    return asked


@_remembered
def _arm(system: MechanicalSystem, inertias: Bodies) -> ArmModel:
    return ArmModel(system.model)


def all_bodies(system: MechanicalSystem, inertias: bool = True) -> Bodies:
    """Return the bodies whose inertias are inputs: all of an arm, or none."""
    return frozenset(range(system.model.njoints - 1)) if inertias else NO_BODIES


def differing_bodies(systems: Sequence[MechanicalSystem]) -> Bodies:
    """Return the bodies whose inertias are not the same in all of some arms."""
    arms = {id(system): np.array(_arm(system).inertial_numbers()) for system in systems}
    tables = [numbers.reshape(-1, _PER_BODY) for numbers in arms.values()]
    alike = [table for table in tables if table.shape == tables[0].shape]
    return frozenset(int(k) for table in alike for k in np.flatnonzero((table != alike[0]).any(axis=1)))


@_remembered
def law_numbers(law: Controller, inertias: Bodies = NO_BODIES) -> Array:
    """Return every number that is an input, in its order, shape (m,): those of the law, and of its arm after them.

    Args:
        law: the law.
        inertias: of which bodies of its arm the inertias are inputs.
    """
    found: list[float] = []
    with_inputs(law, law.system, _keeping(found))
    return np.concatenate([np.array(found, dtype=np.float64), system_numbers(law.system, inertias)])


@_remembered
def system_numbers(system: MechanicalSystem, inertias: Bodies = NO_BODIES) -> Array:
    """Return every number of an arm that is an input, in its order, shape (m,).

    Gravity where it is not 0, the numbers of friction and springs, inertias of some bodies.
    """
    found: list[float] = []
    keep = _keeping(found)
    keep([value for value in _arm(system).gravity if value])
    _with_numbers((system.friction, system.potentials), keep)
    arm = _arm(system).inertial_numbers()
    for k in sorted(inertias):
        keep(arm[_PER_BODY * k : _PER_BODY * (k + 1)])
    return np.array(found, dtype=np.float64)


def numbers_of(thing: Any) -> Array:
    """Return every number of a thing, a body or a disturbance, that is an input, in its order, shape (m,)."""
    found: list[float] = []
    _with_numbers(thing, _keeping(found))
    return np.array(found, dtype=np.float64)


def thing_with_inputs(thing: Any, make: Make, replaced: dict[int, Any] | None = None) -> Any:
    """Return a copy of a thing with other numbers, in the order of ``numbers_of``.

    Args:
        thing: bodies, disturbances, an observer.
        make: returns what replaces the numbers of one array, or one number.
        replaced: what stands in for some of its parts, by id.
    """
    return _with_numbers(thing, make, replaced)


def _keeping(found: list[float]) -> Make:
    def keep(values: list[float]) -> list[Any]:
        found.extend(values)
        return list(values)

    return keep


def with_inputs(law: Controller, system: Any, make: Make) -> Controller:
    """Return a copy of a law that computes with another system, with other numbers.

    All of the law and of what it holds (potential, reference, laws of a schedule) is gone through in order, each once.
    What is 0 in a matrix, and a single number that is 0 or not finite, stays what it is, so that sparse gains stay
    cheap; so do flags, whole numbers and texts.

    Args:
        law: the law.
        system: takes the place of its model.
        make: returns what replaces the numbers of one array, or one number.
    """
    result: Controller = _with_numbers(law, make, {id(law.system): system})
    return result


def system_with_inputs(twin: Any, make: Make, inertias: Bodies = NO_BODIES) -> None:
    """Replace the numbers of an arm in symbols, in the order of ``system_numbers``."""
    arm = twin.arm
    gravity = iter(make([value for value in arm.gravity if value]))
    arm = arm.with_gravity(tuple(next(gravity) if value else 0.0 for value in arm.gravity))
    twin.friction, twin.potentials = _with_numbers((twin.friction, twin.potentials), make)
    if twin.full_damping is not None:
        twin.full_damping = twin.friction
    numbers: list[Any] = arm.inertial_numbers()
    for k in sorted(inertias):
        part = slice(_PER_BODY * k, _PER_BODY * (k + 1))
        numbers[part] = make(numbers[part])
    twin.arm = arm.with_inertial_numbers(numbers) if inertias else arm


def _with_numbers(root: Any, make: Make, replaced: dict[int, Any] | None = None) -> Any:
    """Return a copy of a thing with other numbers; ``replaced`` has what stands in for some of its parts, by id."""
    made: dict[int, Any] = dict(replaced or {})
    kept: list[Any] = []

    def turned(thing: Any) -> Any:
        if isinstance(thing, float):
            return make([float(thing)])[0] if _is_input(thing) else thing
        thing = _plain(thing)
        if id(thing) in made:
            return made[id(thing)]
        result = _turned(thing)
        made[id(thing)] = result
        kept.append(thing)  # so that no other thing gets its id
        return result

    def _turned(thing: Any) -> Any:
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

    return turned(root)


def _is_input(number: float) -> bool:
    return number != 0.0 and math.isfinite(number)


def _replaced(array: Any, make: Make) -> Any:
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


@_remembered
def structure_of(law: Controller, inertias: Bodies = NO_BODIES) -> list[Any]:
    """Return all of a law, and of its arm, that is code and no input: two laws with the same need one compilation."""
    found: list[Any] = []
    _look(law, found, law.system, inertias)
    return found


@_remembered
def system_structure(system: MechanicalSystem, inertias: Bodies = NO_BODIES) -> list[Any]:
    """Return all of an arm that is code and no input."""
    found: list[Any] = []
    _look(system, found, system, inertias)
    return found


def structure_of_things(things: Any) -> list[Any]:
    """Return all of some things, bodies or disturbances, that is code and no input."""
    found: list[Any] = []
    _look(things, found, None, NO_BODIES)
    return found


def _look(root: Any, found: list[Any], own: MechanicalSystem | None, inertias: Bodies) -> None:
    """Write down what of a thing is code; ``own`` is the system whose numbers are inputs."""
    seen: dict[int, int] = {}
    kept: list[Any] = []

    def look(thing: Any) -> None:
        thing = _plain(thing)
        if isinstance(thing, float) and _is_input(thing):
            found.append(float)
            return
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
            mine = thing is own
            found.extend(_arm(thing).structure(inertias if mine else NO_BODIES, mine))
            for part in (thing.friction, thing.potentials):
                (look if mine else look_exactly)(part)
            for part in (thing.coupling, thing.robot.continuous, thing.input_matrix):
                look_exactly(part)
        elif not holds_state(thing):
            found.append(_Same(thing))
        else:
            for name, part in vars(thing).items():
                if not _left_alone(thing, name):
                    found.append(name)
                    look(part)

    def look_exactly(thing: Any) -> None:
        """Look at what has numbers that are code."""
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

    look(root)
