"""Errors inside a law that somebody else wrote, with the place in their file."""

from __future__ import annotations

import inspect
import os
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import AnswerError, InvalidArgumentError, NonFiniteTorqueError, PHControlError

_OURS = __name__.partition(".")[0]
_ANSWERS = ("target", "storage", "shape", "states", "initial_state")  # what a law is asked for


class LawError(PHControlError):
    """A law of one's own raised an error. Says what and, where it is known, where in its file.

    Example:
        >>> from phcontrol import LawError, PHControlError
        >>> try:
        ...     raise LawError("spring", "my_laws.py:12", ZeroDivisionError("division by zero"))
        ... except PHControlError as error:
        ...     print(error)
        my_laws.py:12: spring raised ZeroDivisionError: division by zero
    """

    exit_code = 1

    def __init__(self, law: str, place: str, problem: BaseException) -> None:
        kind = "" if isinstance(problem, PHControlError) else f"{type(problem).__name__}: "
        text = problem.msg if isinstance(problem, SyntaxError) else str(problem)
        words = f"{law}: " if isinstance(problem, AnswerError) else f"{law} raised {kind}"
        super().__init__(f"{f'{place}: ' if place else ''}{words}{text}")
        self.law, self.place = law, place


@contextmanager
def errors_of(name: str, law: type[Controller] | None = None, package: str = "") -> Iterator[None]:
    """Turn what a law of one's own raises into LawError; for a law of phcontrol do nothing.

    Errors of phcontrol pass that such a law raises itself, as when it refuses an argument, and those that it has no
    part in.

    Args:
        name: of the law, for messages.
        law: its class, once there is one.
        package: before that, the top-level package or module that it is looked for in.
    """
    packages = {package} if law is None else _packages(law)
    try:
        yield
    except Exception as error:
        if packages <= {_OURS} or isinstance(error, (KeyboardInterrupt, LawError)):
            raise
        problem = _problem(error)
        if isinstance(problem, PHControlError):
            frames = _frames(problem, packages)
            raised_by_law = bool(frames) and _walk(problem)[-1][0] is frames[-1][0]
            if raised_by_law or not (frames or _blamed(problem, law)):
                raise
        raise LawError(name, place_of(error, law, package), problem) from problem


def place_of(error: BaseException, law: type[Controller] | None, package: str = "") -> str:
    """Return where an error arose in a law's own package, "file.py:12, in target"; "" for a law of phcontrol.

    It is the innermost line there. Where there is none, because phcontrol found fault with what the law answered, it
    is where the law states that.
    """
    packages, problem = {package} if law is None else _packages(law), _problem(error)
    if packages <= {_OURS}:
        return ""
    if isinstance(problem, SyntaxError) and problem.filename and problem.lineno:
        return f"{_shown(problem.filename)}:{problem.lineno}"
    frames = _frames(problem, packages)
    if frames:
        frame, line = frames[-1]
        return f"{_shown(frame.f_code.co_filename)}:{line}, in {frame.f_code.co_name}"
    if law is None:
        return ""
    method, theirs = _blamed(problem, law), [owner for owner in law.__mro__ if _package(owner.__module__) != _OURS]
    for owner in theirs:
        if method in vars(owner):
            return _definition(vars(owner)[method], f", in {method}")
    return _definition(theirs[0], f", in {theirs[0].__name__}")


def _problem(error: BaseException) -> BaseException:
    """Return what ended a run, of the error that says when."""
    while isinstance(error, PHControlError) and isinstance(error.__cause__, PHControlError):
        error = error.__cause__
    return error


def _blamed(error: BaseException, law: type[Controller] | None) -> str:
    """Return the method whose answer phcontrol found fault with; "" for none."""
    if law is None:
        return ""
    if isinstance(error, AnswerError):
        return error.name
    if isinstance(error, NonFiniteTorqueError):
        return "target" if _package(law.shape.__module__) == _OURS else "shape"
    if any(frame.f_code is Controller.evaluate.__code__ for frame, _ in _walk(error)[-1:]):
        return "shape"  # what it states cannot be put together
    name = error.name.partition(".")[0] if isinstance(error, InvalidArgumentError) else ""
    return name if name in _ANSWERS else ""


def _walk(error: BaseException) -> list[tuple[FrameType, int]]:
    return list(traceback.walk_tb(error.__traceback__))


def _frames(error: BaseException, packages: set[str]) -> list[tuple[FrameType, int]]:
    """Return the lines in some packages that an error came through, the innermost last."""
    return [(frame, line) for frame, line in _walk(error) if _package(frame.f_globals.get("__name__", "")) in packages]


def _packages(law: type[Controller]) -> set[str]:
    """Return the top-level packages of a law's class and those it is made of, but for ours."""
    tops = {_package(owner.__module__) for owner in law.__mro__ if issubclass(owner, Controller)}
    return tops - {_OURS} or {_OURS}


def _package(module: str) -> str:
    return module.partition(".")[0]


def _definition(thing: object, end: str) -> str:
    """Return where a function or class is defined."""
    thing = thing.fget if isinstance(thing, property) and thing.fget is not None else thing
    try:
        file = inspect.getsourcefile(thing)  # type: ignore[arg-type]
        line = inspect.getsourcelines(thing)[1]  # type: ignore[arg-type]
    except (OSError, TypeError):  # made in a notebook or by exec
        return end.removeprefix(", ")
    return f"{_shown(file or '')}:{line}{end}"


def _shown(file: str) -> str:
    """Return a file as a user knows it: from the working directory, where it is below it."""
    path = Path(file)
    try:
        return os.fspath(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return file
