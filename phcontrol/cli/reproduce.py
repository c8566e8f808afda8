"""``phcontrol reproduce``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol.cli.showing import check_writable


def reproduce_command(
    out: Annotated[Path, typer.Option(help="Folder of the report.")] = Path("results/thesis"),
    only: Annotated[
        list[str] | None,
        typer.Option(help="A study, or certificates-ARM; may be repeated.", metavar="NAME"),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Run again what has been run.")] = False,
    jobs: Annotated[int | None, typer.Option(help="Processes at a time. Default: one a processor.")] = None,
) -> None:
    """Reproduce the thesis: every study and certificate, into one page.

    Goes on where it was stopped.
    """
    from phcontrol.thesis.reproduce import reproduce

    check_writable(out)
    try:
        result = reproduce(out, only=only, fresh=fresh, jobs=jobs)
    except KeyboardInterrupt as error:
        typer.echo("stopped; what is finished is kept, the same command goes on from there", err=True)
        raise typer.Exit(130) from error
    typer.echo(f"{len(result.run)} tasks run, {len(result.kept)} kept from before")
    typer.echo(result.summary())
    typer.echo(f"\nwrote {result.report}, {out / 'claims.json'}")
    if not result.passed:
        raise typer.Exit(1)
