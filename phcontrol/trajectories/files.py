"""Trajectories from files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from phcontrol.exceptions import DataFileError
from phcontrol.mechanics.robot import Robot
from phcontrol.trajectories.splines import SampledTrajectory


def read_trajectory(path: str | os.PathLike[str], robot: Robot, *, smoothing: float = 0.0) -> SampledTrajectory:
    """Read a motion from a CSV file: a row for each instant, its time [s] and then one position a joint [rad].

    A first row with names is allowed; with it the columns may stand in any order, and must be "time" and the
    joints' names. Raises DataFileError; a file is read as numbers only.

    Args:
        path: of the file.
        robot: whose joints they are.
        smoothing: as in :class:`SampledTrajectory`.
    """
    if Path(path).exists() and not Path(path).is_file():
        raise DataFileError(f"cannot read the trajectory {path}: it is a folder, or a pipe or device without an end")
    try:
        lines = [line for line in Path(path).read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise DataFileError(f"cannot read the trajectory {path}: {error}") from error
    names = ["time", *robot.joint_names]
    order = list(range(len(names)))
    if lines and not _is_number(lines[0].split(",")[0]):
        header = [name.strip() for name in lines.pop(0).split(",")]
        if sorted(header) != sorted(names):
            raise DataFileError(f"cannot read the trajectory {path}: its columns must be {names}, but are {header}")
        order = [header.index(name) for name in names]
    rows = [[_number(path, k, cell) for cell in line.split(",")] for k, line in enumerate(lines, start=1)]
    if not rows or any(len(row) != len(names) for row in rows):
        raise DataFileError(f"cannot read the trajectory {path}: each row must hold {len(names)} numbers: {names}")
    table = np.array(rows)[:, order]
    return SampledTrajectory(table[:, 0], table[:, 1:], smoothing=smoothing)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(path: str | os.PathLike[str], row: int, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise DataFileError(f"cannot read the trajectory {path}: row {row} holds '{text}', not a number") from error
