"""The ``phcontrol`` command: every command by its name."""

from __future__ import annotations

import io
import sys
import warnings
from typing import Annotated, ClassVar

import typer

from phcontrol._version import __version__
from phcontrol.cli.command import plain_app
from phcontrol.cli.errors import DEBUG, say_warning
from phcontrol.cli.lazy_group import LazyGroup, Listed


class Commands(LazyGroup):
    """All commands."""

    listed: ClassVar[dict[str, Listed]] = {
        "run": Listed("phcontrol.cli.run:run_app", "Run a law on any arm, or a study; writes logs and pictures."),
        "certify": Listed(
            "phcontrol.cli.certify:certify",
            "Hold a law's promise against the arm's true motion, at states where laws go wrong.",
        ),
        "analyze": Listed(
            "phcontrol.cli.analyze:analyze", "Look at a closed loop about its rest: modes, stable periods, steps, gain."
        ),
        "design": Listed(
            "phcontrol.cli.design:design",
            "Make a law's gains from what its loop should do, or from what limits it.",
        ),
        "identify": Listed(
            "phcontrol.cli.identify:identify", "Identify payload, friction and rotors of an arm from logs."
        ),
        "init": Listed(
            "phcontrol.cli.init:init",
            "Write a small project: an arm, a law of your own, a test with its certificate, a notebook.",
        ),
        "view": Listed("phcontrol.cli.view:view", "Play logs in a browser: opens one, or prints the address."),
        "reproduce": Listed(
            "phcontrol.cli.reproduce:reproduce_command",
            "Reproduce the thesis: every study and certificate, into one page.",
        ),
        "sweep": Listed(
            "phcontrol.cli.sweep:sweep", "Run what a file describes many times: arms, loads and delays that are drawn."
        ),
        "sweep-report": Listed(
            "phcontrol.cli.sweep_report:sweep_report",
            "Make a page of a sweep's results: what they support, quantiles, maps, the worst runs.",
        ),
        "robots": Listed(
            "phcontrol.cli.robots:robots",
            "List the robots that can be named; a path to a URDF, MJCF or xacro file works too.",
        ),
        "controllers": Listed(
            "phcontrol.cli.controllers:controllers",
            "List the laws, where each comes from, and what it needs measured; those of installed packages too.",
        ),
        "export": Listed(
            "phcontrol.cli.export:export",
            "Write a law as C99 without dependencies or allocation, with a program that replays recorded cases.",
        ),
        "preflight": Listed(
            "phcontrol.cli.preflight:preflight",
            "Look whether this computer can keep a control loop's period: clock, kernel, cores, scheduler, jitter.",
        ),
        "doctor": Listed(
            "phcontrol.cli.doctor:doctor",
            "Say what is installed and found here, and what is missing for what.",
        ),
    }


app = plain_app(
    "Energy-based control of robot arms, with a certificate for every controller.", cls=Commands, add_completion=True
)


@app.callback(invoke_without_command=True)
def version_option(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="End an error with Python's traceback.")] = False,
) -> None:
    """Energy-based control of robot arms, with a certificate for every controller."""
    for stream in (sys.stdout, sys.stderr):  # a file's name may hold what is no text
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    DEBUG[:] = ["--debug"] if debug else []
    if version:
        typer.echo(f"phcontrol {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def run() -> None:
    """Run the command that was asked for."""
    warnings.showwarning = say_warning
    try:
        app()
    except BrokenPipeError:  # the reader of our output has gone
        sys.stderr.close()
        sys.exit(1)
