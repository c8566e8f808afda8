"""``phcontrol preflight``."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from phcontrol.cli.options import JsonOption
from phcontrol.runtime.preflight import preflight as look
from phcontrol.runtime.real_time import RealTime


def preflight(
    period: Annotated[float, typer.Option(help="Of the control loop to come [s].")] = 1e-3,
    seconds: Annotated[float, typer.Option(help="How long to try it [s].")] = 5.0,
    priority: Annotated[int, typer.Option(help="Try it under SCHED_FIFO with this priority, 1 to 99; 0: not.")] = 0,
    lock_memory: Annotated[bool, typer.Option("--lock-memory", help="Try it with all memory locked.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Look whether this computer can keep a control loop's period: clock, kernel, cores, scheduler, jitter.

    Exits with 1 where something is to be changed.
    """
    with RealTime(priority=priority or None, lock_memory=lock_memory) as asked:
        found = look(period, seconds)
    if as_json:
        typer.echo(
            json.dumps(
                {
                    **found._asdict(),
                    "findings": [finding._asdict() for finding in found.findings],
                    "effects": [effect._asdict() for effect in asked.effects],
                    "is_well": found.is_well,
                },
                indent=2,
            )
        )
    else:
        for effect in asked.effects:
            typer.echo(str(effect))
        typer.echo(str(found))
    if not (found.is_well and asked.all_took_effect):
        raise typer.Exit(1)
