"""``phcontrol view``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from phcontrol.cli.errors import say_aside
from phcontrol.cli.options import PortOption
from phcontrol.cli.showing import show
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.loading import load_robot
from phcontrol.simulation.log import Log


def view(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...", help="Logs that runs wrote (.npz): several are shown side by side under one time."
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Option(help="The logs' arm, as in 'run': for the meshes of a URDF file, which a log alone may not open."),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="Write the page to this file (.html), and serve nothing.", show_default=False)
    ] = None,
    port: PortOption = None,
) -> None:
    """Play logs in a browser: opens one, or prints the address."""
    if record is not None and port is not None:
        raise InvalidArgumentError("--port", "is for a page that is served, and --record serves none")
    runs = {name: Log.load(path) for name, path in _named(logs).items()}
    arm = None
    if robot is not None:
        locked = next(iter(runs.values())).metadata.get("robot_record", {}).get("locked_joints", {})
        arm = load_robot(robot, locked_joints=locked)
    shown = runs if len(runs) > 1 else next(iter(runs.values()))
    if record is None:
        show({"": shown}, port, arm)
        return
    from phcontrol.visualization.recording import record as write

    say_aside(f"recorded {write(shown, record, robot=arm)}", aside=False)


def _named(paths: list[Path]) -> dict[str, Path]:
    """Return logs by what tells them apart: their names, their folders', or else their paths."""
    twice = [path for path, times in Counter(path.resolve() for path in paths).items() if times > 1]
    if twice:
        raise InvalidArgumentError("LOG", f"is given twice: {twice[0].name}")
    for names in ([path.stem for path in paths], [path.resolve().parent.name for path in paths], list(map(str, paths))):
        if len(set(names)) == len(names):
            break
    return dict(zip(names, paths, strict=True))
