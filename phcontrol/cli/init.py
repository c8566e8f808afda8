"""``phcontrol init``."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from phcontrol._files import check_folder, write_text
from phcontrol.cli.arm_options import ArmOptions
from phcontrol.cli.options import ArmatureOption, LockOption, RobotOption
from phcontrol.cli.project_files import files_of
from phcontrol.controllers.registry import make_controller
from phcontrol.exceptions import DataFileError, InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.position import SHORTEST_STEP, longest_stable_step, reachable_goal


def init(
    folder: Annotated[Path, typer.Argument(help="The new folder; an empty one does too.", metavar="FOLDER")],
    robot: RobotOption = "ur5",
    lock: LockOption = None,
    armature: ArmatureOption = None,
) -> None:
    """Write a small project: an arm, a law of your own, a test with its certificate, a notebook."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidArgumentError("FOLDER", f"must be a new or an empty folder, but {folder} is there already")
    locked = list(lock or [])
    system = ArmOptions(locked, armature).system(robot)
    found = system.robot
    _check_that_it_can_be_simulated(system)
    try:
        check_folder(folder)
    except OSError as error:
        raise DataFileError(f"cannot write to {folder}: {error.strerror or error}") from error
    title = folder.resolve().name
    source = os.path.relpath(robot, folder) if Path(robot).is_file() else robot
    rotors = None if armature is None else [float(rotor) for rotor in found.model.armature]
    written = [
        write_text(folder / name, text) for name, text in files_of(title, found.name, source, locked, rotors).items()
    ]
    typer.echo(f"wrote {', '.join(path.name for path in written)} to {folder}: a law of your own for {found.name}")
    typer.echo(f"next: cd {folder} && python -m pytest")
    if find_spec("pytest") is None:
        typer.echo("for that, pytest is missing: pip install pytest")


def _check_that_it_can_be_simulated(system: MechanicalSystem) -> None:
    """Raise InvalidArgumentError for an arm whose friction needs steps that are too short, for want of rotors."""
    goal = reachable_goal(system.robot)
    longest, joint = longest_stable_step(make_controller("energy_shaping", system, goal), goal)
    if 0.5 * longest < SHORTEST_STEP:
        raise InvalidArgumentError(
            "--armature",
            f"must be given for {system.robot.name}, 0.05 for instance: friction brakes joint '{joint}' so hard that "
            f"a run needs steps of {0.5 * longest:.1g} s, because its description has friction but no rotor inertia",
        )
