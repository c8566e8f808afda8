"""``phcontrol sweep-report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def sweep_report(
    folder: Annotated[Path, typer.Argument(help="The folder of a sweep.", metavar="DIR")],
    spec: Annotated[
        str, typer.Option(help="What the commands that replay runs call the sweep's file.", metavar="SPEC.toml")
    ] = "SPEC.toml",
    measure: Annotated[
        str | None, typer.Option(help="What the maps show. Default: the required one that the fewest runs keep.")
    ] = None,
    confidence: Annotated[float, typer.Option(help="Of what is said about all that could be drawn.")] = 0.95,
) -> None:
    """Make a page of a sweep's results: what they support, quantiles, maps, the worst runs."""
    from phcontrol.sweeps.report import write_report
    from phcontrol.sweeps.sweep_results import SweepResults

    results = SweepResults.read(folder)
    typer.echo(results.summary(confidence))
    written = write_report(results, spec=spec, measure=measure, confidence=confidence)
    typer.echo("\nwrote " + ", ".join(map(str, written)) + ": open the page in any browser")
