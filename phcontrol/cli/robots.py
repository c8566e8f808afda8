"""``phcontrol robots``."""

from __future__ import annotations

import json

import typer

from phcontrol.cli.options import JsonOption
from phcontrol.mechanics.catalogue import example_robots, installed, shipped_robots


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
    rows += [
        {"name": name, "source": entry["package"], "fixed_base": True, "title": entry["title"]}
        for name, entry in installed().items()
    ]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        if row["source"] == "phcontrol":
            typer.echo(f"{row['name']:<22}{row['title']}")
    typer.echo("\nfrom packages of others (pip install ...; licences in the documentation):")
    for name, entry in installed().items():
        typer.echo(f"{name:<22}{entry['title']} ({entry['package']})")
    names = [str(row["name"]) for row in rows if row["source"] == "example-robot-data" and row["fixed_base"]]
    typer.echo(f"\nfrom example-robot-data (fixed base): {', '.join(names)}")
