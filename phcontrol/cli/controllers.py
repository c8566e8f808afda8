"""``phcontrol controllers``."""

from __future__ import annotations

import json

import typer

from phcontrol.cli.options import JsonOption
from phcontrol.controllers.registry import CONTROLLERS


def controllers(as_json: JsonOption = False) -> None:
    """List the laws, where each comes from, and what it needs measured."""
    if as_json:
        rows = [
            {"name": name, "summary": entry.summary, "source": entry.source, "needs": entry.needs}
            for name, entry in CONTROLLERS.items()
        ]
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    for name, entry in CONTROLLERS.items():
        typer.echo(f"{name}\n    {entry.summary}\n    from {entry.source}; needs {entry.needs}")
