"""``phcontrol view``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol.cli.options import PortOption
from phcontrol.cli.showing import show
from phcontrol.mechanics.loading import load_robot
from phcontrol.simulation.log import Log


def view(
    log: Annotated[Path, typer.Argument(help="A log that a run wrote (.npz).")],
    robot: Annotated[
        str | None,
        typer.Option(help="The log's arm, as in 'run': for the meshes of a URDF file, which a log alone may not open."),
    ] = None,
    port: PortOption = None,
) -> None:
    """Play a log in a browser: opens one, or prints the address."""
    run = Log.load(log)
    if robot is None:
        show({"": run}, port)
        return
    locked = run.metadata.get("robot_record", {}).get("locked_joints", {})
    show({"": run}, port, load_robot(robot, locked_joints=locked))
