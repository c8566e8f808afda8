"""``phcontrol export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol.cli.arm import goal_of
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.laws import law_of
from phcontrol.cli.options import (
    ControllerOption,
    FormOption,
    GoalOption,
    RobotOption,
    SetOption,
)
from phcontrol.cli.texts import settings_of
from phcontrol.compilation.compiled_law import need_casadi
from phcontrol.controllers.law_error import errors_of
from phcontrol.controllers.registry import make_controller


def export(
    controller: ControllerOption,
    out: Annotated[Path, typer.Option(help="Folder that the files are written to.", metavar="DIR")],
    robot: RobotOption = "pera",
    goal: GoalOption = None,
    interconnection: FormOption = "coriolis",
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    single: Annotated[bool, typer.Option("--float", help="Write floats in place of doubles.")] = False,
) -> None:
    """Write a law as C99 without dependencies or allocation, with a program that replays recorded cases."""
    need_casadi()
    from phcontrol.compilation.export import export_law

    system, entry = arm.system(robot), law_of(controller)
    options = settings_of(settings, "interconnection", "goal")
    with errors_of(controller, entry.law):
        law = make_controller(
            controller, system, goal_of(system, goal, None, None), interconnection=interconnection, **options
        )
    written = export_law(law, out, single=single)
    ways = f", {written.ways} ways through its branches" if written.ways > 1 else ""
    typer.echo(f"{controller} of {system.robot.name}: {written.operations} operations a step at most{ways}")
    typer.echo(f"largest relative difference from the interpreted law: {written.difference:.1e}")
    for file in written.files:
        typer.echo(f"wrote {file}")
