"""A function as a command of the command line."""

from __future__ import annotations

import contextlib
import functools
import inspect
import os
from collections.abc import Callable
from typing import Annotated, Any, get_type_hints

import typer

from phcontrol.cli.errors import QUIET, reports_errors
from phcontrol.cli.once_command import OnceCommand
from phcontrol.cli.option_group import OptionGroup

SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 110}
"""Of every command: -h is --help, and texts are as wide as the window, up to a line that is read well."""

_QUIET = Annotated[bool, typer.Option("-q", "--quiet", help="Print nothing but errors and warnings.")]


def plain_app(help_text: str, **settings: Any) -> typer.Typer:
    """Return an empty group of commands that looks as all do."""
    return typer.Typer(
        help=help_text,
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings=SETTINGS,
        **settings,
    )


def add_command(group: typer.Typer, name: str, function: Callable[..., None], **texts: Any) -> None:
    """Add a function to a group: with -h, -q, and errors of one line."""
    group.command(name, cls=OnceCommand, context_settings=SETTINGS, **texts)(reports_errors(_quiet(function)))


def command_of(name: str, function: Callable[..., None] | typer.Typer) -> Any:
    """Return a function, or a group, as a command that other groups can hold."""
    if not isinstance(function, typer.Typer):
        group = plain_app("", add_completion=False)
        add_command(group, name, function)
        return typer.main.get_command(group)
    command = typer.main.get_command(function)
    command.name = name
    return command


def _quiet(function: Callable[..., None]) -> Callable[..., None]:
    """Return a command with the option -q, and an option for each field of its groups."""
    signature, hints = inspect.signature(function), get_type_hints(function, include_extras=True)
    groups = {name: hint for name, hint in hints.items() if isinstance(hint, type) and issubclass(hint, OptionGroup)}

    @functools.wraps(function)
    def command(*, quiet: bool = False, **arguments: Any) -> None:
        arguments |= {name: group.taken_from(arguments) for name, group in groups.items()}
        QUIET[:] = ["--quiet"] if quiet else []
        with contextlib.ExitStack() as stack:
            stack.callback(QUIET.clear)
            if quiet:
                nowhere = stack.enter_context(open(os.devnull, "w", encoding="utf-8"))
                stack.enter_context(contextlib.redirect_stdout(nowhere))
            function(**arguments)

    option = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=_QUIET)
    parameters = []
    for name, parameter in signature.parameters.items():
        alone = parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[name])
        parameters += groups[name].parameters() if name in groups else [alone]
    parameters.append(option)
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return command
