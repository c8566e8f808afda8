"""``phcontrol robots``."""

from __future__ import annotations

import json

import typer

from phcontrol.cli.options import JsonOption
from phcontrol.mechanics.catalogue import example_robots, shipped_robots


def robots(as_json: JsonOption = False) -> None:
    """List the robots that can be named; a path to a URDF, MJCF or xacro file works too."""
    rows = [
        {"name": name, "source": "phcontrol", "fixed_base": True, "title": title}
        for name, title in shipped_robots().items()
    ]
    rows += [
        {"name": name, "source": "example-robot-data", "fixed_base": not floating, "title": ""}
        for name, floating in example_robots().items()
    ]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        if row["source"] == "phcontrol":
            typer.echo(f"{row['name']:<22}{row['title']}")
    names = [str(row["name"]) for row in rows if row["source"] != "phcontrol" and row["fixed_base"]]
    typer.echo(f"\nfrom example-robot-data (fixed base): {', '.join(names)}")
