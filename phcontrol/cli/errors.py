"""Errors as a user of the command line sees them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

from phcontrol.exceptions import PHControlError

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

DEBUG: list[str] = []
"""Holds something where errors shall end with Python's traceback (--debug)."""


def reports_errors(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Turn our own errors into one line on stderr and its exit code; not with --debug."""

    @functools.wraps(command)
    def wrapped(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        try:
            return command(*args, **kwargs)
        except PHControlError as error:
            if DEBUG:
                raise
            say_error(str(error))
            raise typer.Exit(error.exit_code) from error

    return wrapped


QUIET: list[str] = []
"""Holds something where nothing is to be said but errors and warnings (--quiet)."""


def say_aside(message: str, aside: bool = True) -> None:
    """Say where something was written: on stdout, or on stderr beside JSON; not with --quiet."""
    if not QUIET:
        typer.echo(message, err=aside)


def say_error(message: str) -> None:
    """Print an error in one line on stderr."""
    typer.echo(f"error: {_one_line(message)}", err=True)


def say_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning in one line on stderr, without where in our code it was made: for ``warnings.showwarning``."""
    typer.echo(f"warning: {_one_line(str(message))}", err=True)


def _one_line(text: str) -> str:
    """Return a message in one line, without what a terminal would obey: parts of it may come from a file."""
    return "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
