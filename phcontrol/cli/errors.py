"""Errors as a user of the command line sees them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

from phcontrol.controllers.law_error import LawError
from phcontrol.exceptions import PHControlError
from phcontrol.simulation.simulation_error import SimulationInterrupted

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

DEBUG: list[str] = []
"""Holds something where errors shall end with Python's traceback (--debug)."""


def reports_errors(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Turn our own errors into one line on stderr and exit code 2, those of a user's own law 1; not with --debug."""

    @functools.wraps(command)
    def wrapped(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        try:
            return command(*args, **kwargs)
        except PHControlError as error:
            if DEBUG:
                raise
            say_error(str(error))
            code = 130 if isinstance(error, SimulationInterrupted) else 1 if isinstance(error, LawError) else 2
            raise typer.Exit(code) from error

    return wrapped


def say_error(message: str) -> None:
    """Print an error in one line on stderr."""
    typer.echo(f"error: {_one_line(message)}", err=True)


def _one_line(text: str) -> str:
    """Return a message in one line, without what a terminal would obey: parts of it may come from a file."""
    return "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
