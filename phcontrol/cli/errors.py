"""Errors as a user of the command line sees them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

from phcontrol.exceptions import PHControlError
from phcontrol.simulation.simulation_error import SimulationInterrupted

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def reports_errors(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Turn our own errors into one line on stderr and exit code 2."""

    @functools.wraps(command)
    def wrapped(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        try:
            return command(*args, **kwargs)
        except PHControlError as error:
            typer.echo(f"error: {_one_line(str(error))}", err=True)
            raise typer.Exit(130 if isinstance(error, SimulationInterrupted) else 2) from error

    return wrapped


def _one_line(text: str) -> str:
    """Return a message in one line, without what a terminal would obey: parts of it may come from a file."""
    return "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
