"""``phcontrol run STUDY``: a command for every study of the thesis."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from phcontrol.cli.errors import say_aside
from phcontrol.cli.options import JsonOption, PortOption, RecordOption
from phcontrol.cli.showing import check_port_is_used, check_writable, record_logs, show
from phcontrol.thesis.registry import run_study


def study_command(name: str) -> Callable[..., None]:
    """Return ``run NAME``: run a study, and write its figures, logs and claims."""

    def command(
        out: Annotated[Path | None, typer.Option(help="Folder. Default: results/NAME.")] = None,
        view: Annotated[bool, typer.Option("--view", help="Then play its runs in a browser.")] = False,
        record: RecordOption = None,
        port: PortOption = None,
        as_json: JsonOption = False,
    ) -> None:
        folder = Path("results") / name if out is None else out
        check_writable(folder, record)
        if not view:
            check_port_is_used(port)
        outcome = run_study(name)
        typer.echo(json.dumps(outcome.to_dict(), indent=2) if as_json else outcome.summary())
        say_aside("\nwrote " + ", ".join(str(path) for path in outcome.write(folder)), as_json)
        record_logs(outcome.logs, record, err=as_json)
        if view:
            show(outcome.logs, port)

    return command
