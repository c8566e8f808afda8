"""The time during which modules of laws see the arithmetic of symbols."""

from __future__ import annotations

import dis
import functools
import sys
import threading
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import CodeType, FunctionType, ModuleType
from typing import Any

import casadi

from phcontrol.compilation.arithmetic import BUILT_IN, STAND_INS
from phcontrol.compilation.errors import NotTraceableError
from phcontrol.compilation.symbol import INNER, REFUSALS, TRACING, plain_terms

_PLACES = ("controllers", "potentials", "trajectories", "vision", "mechanics", "environments", "sensors")
_NO_PARTS = ("numpy", "pinocchio", "coal", "builtins")
_OWN = "phcontrol."
_LOCK = threading.RLock()
_MISSING = object()
_COMPARISONS = ("IS_OP", "COMPARE_OP", "CONTAINS_OP")
_NEAR = 7  # instructions
_IDLE = ("CACHE", "PUSH_NULL", "EXTENDED_ARG", "NOP", "RESUME")


def is_law_module(name: str) -> bool:
    """Whether a module of phcontrol is one that laws are made of."""
    places = tuple(f"{_OWN}{place}." for place in _PLACES)
    return (name.startswith(places) and not name.endswith("_lapack")) or name == f"{_OWN}_smooth"


@contextmanager
def tracing(classes: Iterable[Any]) -> Iterator[None]:
    """Let the modules of phcontrol's laws, and of other classes and functions, compute with symbols.

    Their names for NumPy, ``math``, LAPACK and the kernels stand for :data:`STAND_INS` meanwhile, which do with plain
    numbers what they always do. One trace at a time; laws that run meanwhile in other threads run right, and slower.
    """
    names = {name for name in sys.modules if is_law_module(name)} | {found.__module__ for found in classes}
    modules = [sys.modules[name] for name in sorted(names) if isinstance(sys.modules.get(name), ModuleType)]
    with _LOCK:
        before: list[tuple[dict[str, Any], str, Any]] = []
        try:
            for module in modules:
                space = vars(module)
                for name, value in list(space.items()):
                    stand_in = next((new for old, new in STAND_INS if old is value), None)
                    if stand_in is not None:
                        before.append((space, name, value))
                        space[name] = stand_in
                for name, stand_in in BUILT_IN.items():
                    if name == "float" and compares_float(module):
                        continue
                    before.append((space, name, space.get(name, _MISSING)))
                    space[name] = stand_in
            TRACING.add(threading.get_ident())
            REFUSALS.clear()
            plain_terms()
            yield
            if REFUSALS:  # and the law caught it
                raise REFUSALS[0]
        finally:
            TRACING.discard(threading.get_ident())
            for space, name, value in reversed(before):
                if value is _MISSING:
                    del space[name]
                else:
                    space[name] = value


@contextmanager
def simplifying() -> Iterator[None]:
    """Let CasADi simplify meanwhile what is made where all that it may assume is guarded; no trace runs."""
    with _LOCK:
        casadi.GlobalOptions.setSimplificationOnTheFly(True)
        try:
            yield
        finally:
            plain_terms()


@functools.cache
def compares_float(module: ModuleType) -> bool:
    """Whether a module asks whether a type is ``float`` itself, or one of some: there that name is left as it is.

    Another thread that runs the same code while a law is traced would get another answer. In such a module
    ``float(…)`` of what depends on the state is refused.
    """
    return any(_compares_float(code) for code in _codes_of(module))


def _compares_float(code: CodeType) -> bool:
    steps = [step for step in dis.get_instructions(code) if step.opname not in _IDLE]
    for place, step in enumerate(steps):
        if step.argval != "float" or not step.opname.startswith("LOAD_"):
            continue
        if steps[place + 1].opname in _COMPARISONS:
            return True
        later = [found.opname for found in steps[place + 1 : place + _NEAR]]
        if any(name.startswith("BUILD_") for name in later) and "CONTAINS_OP" in later:  # type(x) in (int, float)
            return True
    return False


def _codes_of(module: ModuleType) -> Iterator[CodeType]:
    """Yield the code of the functions and classes of a module, and of the functions inside them."""
    waiting = [thing for thing in vars(module).values() if getattr(thing, "__module__", None) == module.__name__]
    while waiting:
        thing = waiting.pop()
        if isinstance(thing, CodeType):
            yield thing
            waiting.extend(part for part in thing.co_consts if isinstance(part, CodeType))
        elif isinstance(thing, type):
            waiting.extend(vars(thing).values())
        else:
            parts = (getattr(thing, name, None) for name in ("__func__", "fget", "fset", "compute", "__code__"))
            waiting.extend(part for part in parts if part is not None)


def refusal(law: str, error: BaseException) -> NotTraceableError:
    """Return the error that says why a law cannot be traced, and at which line."""
    if error in REFUSALS:  # it names the line
        return NotTraceableError(f"{law} cannot be compiled: {error}")
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    lines = [line for _, line in traceback.walk_tb(error.__traceback__)]
    place = ""
    for frame, line in reversed(list(zip(frames, lines, strict=True))):
        module = frame.f_globals.get("__name__", "")
        if not module.startswith(INNER):
            file = frame.f_code.co_filename.rpartition("/")[2]
            place = f" ({file}:{line}, in {frame.f_code.co_name})"
            break
    text = (str(error) or type(error).__name__).splitlines()[0]
    return NotTraceableError(f"{law} cannot be compiled: {text}{place}")


def classes_of(*things: Any) -> set[Any]:
    """Return the classes, and those that they are made of, of objects and of what they hold, and functions in them."""
    found: set[Any] = set()
    seen: set[int] = set()
    waiting = list(things)
    while waiting:
        thing = waiting.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, (list, tuple, set)):
            waiting.extend(thing)
        elif isinstance(thing, dict):
            waiting.extend(thing.values())
        elif isinstance(thing, functools.partial):
            waiting.extend([thing.func, thing.args, thing.keywords])
        elif isinstance(thing, FunctionType):  # of a user's own: an action, a stiffness, a disturbance
            found.add(thing)
        elif holds_state(thing):
            found |= {kind for kind in type(thing).__mro__ if kind is not object}
            waiting.extend(vars(thing).values())
    return {kind for kind in found if kind.__module__ not in ("abc", "typing", "builtins")}


def holds_state(thing: Any) -> bool:
    """Whether a thing is a part of a law: an object of Python with attributes, no module, class, model or system."""
    from phcontrol.mechanics.robot import Robot
    from phcontrol.mechanics.state import MechanicalState
    from phcontrol.mechanics.system import MechanicalSystem

    if isinstance(thing, (type, ModuleType, Robot, MechanicalState, MechanicalSystem)) or callable(thing):
        return False
    return hasattr(thing, "__dict__") and not type(thing).__module__.startswith(_NO_PARTS)
