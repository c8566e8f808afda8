"""One run of an arm under a law: made, reported, written, shown."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from phcontrol.cli.errors import say_aside, say_error
from phcontrol.cli.laws import law_of
from phcontrol.cli.showing import Showing, check_writable, record_logs, watching
from phcontrol.controllers.law_error import errors_of
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.position import PositionRun, run_position
from phcontrol.simulation.simulation_error import SimulationError


def run_and_write(
    system: MechanicalSystem,
    folder: Path,
    showing: Showing,
    *,
    controller: str,
    study: Callable[..., PositionRun] = run_position,
    **arguments: Any,
) -> None:
    """Run, print the summary, write and show the results; exit code 1 when certificate or limits were not kept."""
    check_writable(folder, showing.record)
    law = law_of(controller).law
    with watching(showing) as watch:
        with errors_of(controller, law):
            result = _run(study, system, folder, watch=watch, controller=controller, **arguments)
            summary = json.dumps(result.to_dict(), indent=2) if showing.as_json else result.summary()
        typer.echo(summary)
        written = result.write(folder)
        say_aside("\nwrote " + ", ".join(map(str, written)), showing.as_json)
        record_logs({"": result.log}, showing.record, err=showing.as_json, certificate=result.certificate)
        if watch is not None:
            watch.linger(result.log)
    if result.certificate.error:
        say_error(f"{controller} raised {result.certificate.error}")
    if result.departures:
        typer.echo(f"warning: the run left the limits of {result.robot.name}: {'; '.join(result.departures)}", err=True)
    if result.departures or not result.certificate.passed:
        raise typer.Exit(1)


def _run(study: Callable[..., PositionRun], system: MechanicalSystem, folder: Path, **arguments: Any) -> PositionRun:
    """Run, and when the run fails keep what there is of its log."""
    try:
        return study(system, **arguments)
    except SimulationError as error:
        if len(error.log):
            place = error.log.save(folder / "log-stopped.npz", at_once=True)
            typer.echo(f"kept the log so far, without energies, in {place}", err=True)
        raise
