"""``phcontrol controllers``."""

from __future__ import annotations

import json

import typer

from phcontrol.cli.errors import say_error
from phcontrol.cli.options import JsonOption
from phcontrol.controllers.registry import all_laws


def controllers(as_json: JsonOption = False) -> None:
    """List the laws, where each comes from, and what it needs measured; those of installed packages too."""
    laws, problems = all_laws()
    for problem in problems:
        say_error(problem)
    if as_json:
        rows = [
            {"name": name, "summary": entry.summary, "source": entry.source, "needs": entry.needs}
            | {"origin": entry.origin}
            for name, entry in laws.items()
        ]
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    for name, entry in laws.items():
        offered = "" if entry.origin == "phcontrol" else f"; of {entry.origin}"
        typer.echo(f"{name}\n    {entry.summary}\n    from {entry.source}; needs {entry.needs}{offered}")
