"""The ``phcontrol`` command: every command by its name."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from phcontrol._version import __version__
from phcontrol.cli.certify import certify
from phcontrol.cli.controllers import controllers
from phcontrol.cli.doctor import doctor
from phcontrol.cli.errors import DEBUG, reports_errors
from phcontrol.cli.export import export
from phcontrol.cli.identify import identify
from phcontrol.cli.reproduce import reproduce_command
from phcontrol.cli.robots import robots
from phcontrol.cli.run_cartesian import impedance, tracking
from phcontrol.cli.run_law import law_command
from phcontrol.cli.run_pick import pick
from phcontrol.cli.run_position import position
from phcontrol.cli.run_servo import servo
from phcontrol.cli.run_study import study_command
from phcontrol.cli.run_track import track
from phcontrol.cli.view import view
from phcontrol.controllers.own_laws import installed_laws, origin_of
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.thesis.registry import STUDIES

app = typer.Typer(
    help="Energy-based control of robot arms, with a certificate for every controller.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)
run_app = typer.Typer(
    help="Run a law on any arm, or a study; writes logs and pictures.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(run_app, name="run")


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


def _add(group: typer.Typer, name: str, command: Callable[..., None], **texts: Any) -> None:
    group.command(name, **texts)(reports_errors(command))


_add(run_app, "position", position)
_add(run_app, "track", track, short_help="Follow a trajectory with any arm, and certify the law that does it.")
_add(run_app, "servo", servo)
_add(run_app, "pick", pick, short_help="See an object, reach it, grasp it: 20 random poses, from rendered images.")
_RUNS: dict[str, Callable[..., None]] = {
    "position": position,
    "servo": servo,
    "cartesian_impedance": impedance,
    "cartesian_tracking": tracking,
}
for _name, _entry in CONTROLLERS.items():
    _add(
        run_app,
        _name,
        law_command(_name, _RUNS[_entry.law.run]),
        help=f"Run an arm under {_name}: {_entry.summary}.",
        short_help=f"law: {_entry.summary}",
    )
for _name, _points in installed_laws().items():  # nothing of them is imported before it is asked for
    if _name not in CONTROLLERS:
        _text = f"a law of {origin_of(_points[0])}"
        _add(run_app, _name, law_command(_name, position), help=f"Run an arm under {_name}, {_text}.", short_help=_text)
for _name, _study in STUDIES.items():
    _add(
        run_app,
        _name,
        study_command(_name),
        help=f"Run {_study.summary}; write figures, logs and claims.json.",
        short_help=_study.summary,
    )
_add(app, "view", view)
_add(app, "certify", certify)
_add(app, "identify", identify)
_add(app, "reproduce", reproduce_command)
_add(app, "robots", robots)
_add(app, "controllers", controllers)
_add(app, "export", export)
_add(app, "doctor", doctor)


def main() -> None:
    """Entry point of the ``phcontrol`` command."""
    try:
        app()
    except BrokenPipeError:  # the reader of our output has gone
        sys.stderr.close()
        sys.exit(1)
