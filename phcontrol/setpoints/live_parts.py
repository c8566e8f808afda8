"""Finding what of a law is changed while it runs."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.setpoints.live_motion import LiveMotion


def live_parts(thing: Any) -> list[LiveMotion[Any]]:
    """Return the live parts that a thing holds: in its attributes, in containers, and in what functions close over."""
    found: list[LiveMotion[Any]] = []
    seen: set[int] = set()
    waiting = [thing]
    while waiting:
        each = waiting.pop()
        if id(each) in seen:
            continue
        seen.add(id(each))
        if isinstance(each, LiveMotion):
            found.append(each)
        elif not isinstance(each, (type, ModuleType, Robot, MechanicalSystem)):
            waiting.extend(_parts(each))
    return found


def _parts(thing: Any) -> Iterator[Any]:
    if isinstance(thing, (list, tuple, set, frozenset)):
        yield from thing
    elif isinstance(thing, dict):
        yield from thing.values()
    elif isinstance(thing, functools.partial):
        yield from (thing.func, thing.args, thing.keywords)
    else:
        for cell in getattr(thing, "__closure__", None) or ():
            try:
                yield cell.cell_contents
            except ValueError:  # empty
                continue
        yield getattr(thing, "__self__", None)
        attributes = getattr(thing, "__dict__", None)
        if isinstance(attributes, dict):
            yield from attributes.values()
