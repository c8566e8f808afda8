"""``phcontrol init``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from phcontrol._files import check_folder, write_text
from phcontrol.cli.options import LockOption, RobotOption
from phcontrol.cli.project_files import files_of
from phcontrol.exceptions import DataFileError, InvalidArgumentError
from phcontrol.mechanics.loading import load_robot


def init(
    folder: Annotated[Path, typer.Argument(help="The new folder; an empty one does too.", metavar="FOLDER")],
    robot: RobotOption = "ur5",
    lock: LockOption = None,
) -> None:
    """Write a small project: an arm, a law of your own, a test with its certificate, a notebook."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidArgumentError("FOLDER", f"must be a new or an empty folder, but {folder} is there already")
    locked = list(lock or [])
    found = load_robot(robot, locked_joints=locked)
    try:
        check_folder(folder)
    except OSError as error:
        raise DataFileError(f"cannot write to {folder}: {error.strerror or error}") from error
    title = folder.resolve().name
    source = os.path.relpath(robot, folder) if Path(robot).is_file() else robot
    written = [write_text(folder / name, text) for name, text in files_of(title, found.name, source, locked).items()]
    typer.echo(f"wrote {', '.join(path.name for path in written)} to {folder}: a law of your own for {found.name}")
    typer.echo(f"next: cd {folder} && pytest")
