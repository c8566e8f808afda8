"""Trajectories from files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from phcontrol._validation import decimal
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
    try:
        if Path(path).exists() and not Path(path).is_file():
            raise OSError("it is a folder, or a pipe or device without an end")
        text = Path(path).read_text(encoding="utf-8-sig")  # spreadsheets begin a file with a byte-order mark
    except (OSError, ValueError) as error:  # bytes that are no text, a path that can be none
        raise DataFileError(f"cannot read the trajectory {path}: {error}") from error
    lines = [line.split(",") for line in text.splitlines() if line.strip()]
    names = ["time", *robot.joint_names]
    order = list(range(len(names)))
    if lines and decimal(lines[0][0]) is None:
        header = [name.strip() for name in lines.pop(0)]
        if sorted(header) != sorted(names):
            raise DataFileError(f"cannot read the trajectory {path}: its columns must be {names}, but are {header}")
        order = [header.index(name) for name in names]
    rows = [[_number(path, k, cell) for cell in cells] for k, cells in enumerate(lines, start=1)]
    if not rows or any(len(row) != len(names) for row in rows):
        raise DataFileError(f"cannot read the trajectory {path}: each row must hold {len(names)} numbers: {names}")
    table = np.array(rows)[:, order]
    return SampledTrajectory(table[:, 0], table[:, 1:], smoothing=smoothing)


def _number(path: str | os.PathLike[str], row: int, text: str) -> float:
    value = decimal(text)
    if value is None:
        raise DataFileError(
            f"cannot read the trajectory {path}: row {row} holds '{text}', not a number such as 0.25 or 1e-3"
        )
    return value
