"""``phcontrol identify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol._files import write_json
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.showing import check_writable
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.identification.identify import UNTOLD
from phcontrol.identification.identify import identify as identify_parameters
from phcontrol.identification.parameters import GROUPS, SMOOTHING
from phcontrol.simulation.log import Log


def identify(
    logs: Annotated[list[Path], typer.Argument(help="Logs (.npz) of an arm that moved.", metavar="LOG")],
    what: Annotated[
        str, typer.Option(help=f"What to identify, comma-separated: {', '.join(GROUPS)}.")
    ] = "payload,coulomb,viscous",
    robot: Annotated[
        str | None,
        typer.Option(help="The model that all else is taken from, as in 'run'. Default: the arm of the first log."),
    ] = None,
    frame: Annotated[str | None, typer.Option(help="What carries the payload. Default: the tool frame.")] = None,
    window: Annotated[float, typer.Option(help="How long torques are averaged [s].")] = 0.2,
    validation: Annotated[float, typer.Option(help="Part of each log that is kept back and predicted.")] = 0.25,
    smoothing: Annotated[
        float, typer.Option(help="Of the sign in the Coulomb friction [rad²/s²]; 1e-6 ends it at some mrad/s.")
    ] = SMOOTHING,
    untold: Annotated[
        str, typer.Option(help=f"Parameters that the logs do not tell: {' or '.join(UNTOLD)} the model's.")
    ] = "refuse",
    arm: ArmOptions = AS_DESCRIBED,
    out: Annotated[Path, typer.Option(help="Folder for the result and the picture.")] = Path("results/identify"),
) -> None:
    """Identify payload, friction and rotors of an arm from logs.

    Exit code 1 when data kept back do not confirm it.
    """
    check_writable(out)
    read = [Log.load(path) for path in logs]
    if robot is None and arm.given:
        raise InvalidArgumentError(arm.given[0].split()[0], "is of the model that --robot names, which is not given")
    model = None if robot is None else arm.system(robot)
    found = identify_parameters(
        read,
        [name.strip() for name in what.split(",")],
        model=model,
        frame=frame,
        window=window,
        validation=validation,
        smoothing=smoothing,
        untold=untold,
    )
    typer.echo(str(found))
    from phcontrol.visualization.identification_figure import identification_figure
    from phcontrol.visualization.plots import save_figure

    result = write_json(out / "identification.json", found.to_dict())
    typer.echo(f"wrote {result}, {save_figure(identification_figure(found), out / 'torques.png')}")
    if not found.passed:
        raise typer.Exit(1)
