"""Runs kept as one page, to be opened by anyone, offline."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from phcontrol._files import write_text
from phcontrol._validation import Array, instance, positive
from phcontrol.analysis.certificate import Certificate
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.simulation.log import Log
from phcontrol.visualization.page import page
from phcontrol.visualization.shown_run import ShownRun
from phcontrol.visualization.stage import Stage

LARGEST = 6000
"""Frames at most: a longer run has fewer a second."""


def record(
    log: Log | Mapping[str, Log],
    path: str | os.PathLike[str],
    *,
    robot: Robot | None = None,
    rate: float = 30.0,
    certificate: Certificate | None = None,
) -> Path:
    """Write a page that plays runs in a browser, without a network: the arm, and any signal of the log over time.

    Several runs stand side by side under one time, and their signals lie over each other.

    Args:
        log: the run, of ``simulate`` or of ``Log.load``; or up to four by what they shall be called.
        path: of the HTML file, written atomically.
        robot: the arm, where the log does not hold its description.
        rate: frames a second [Hz]; between them the page interpolates.
        certificate: of the law of a single run, shown as a badge.

    Raises DataFileError when the file cannot be written, InvalidArgumentError for no runs, or too many.

    Example:
        >>> import tempfile
        >>> from phcontrol import EnergyShaping, MechanicalSystem, load_robot, record, simulate
        >>> system = MechanicalSystem(load_robot("pera_gripper"))
        >>> log = simulate(system, EnergyShaping.tuned(system, [0.3]), duration=0.2, dt=5e-3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     page = record(log, folder + "/run.html")
        ...     print("<html" in page.read_text()[:200])
        True
    """
    return write_text(path, recorded_page(log, robot=robot, rate=rate, certificate=certificate))


def recorded_page(
    log: Log | Mapping[str, Log],
    *,
    robot: Robot | None = None,
    rate: float = 30.0,
    script: str | None = None,
    certificate: Certificate | None = None,
) -> str:
    """Return that page as text; with the address of MeshCat's ``script``, that is not part of it."""
    logs = log if isinstance(log, Mapping) else {"": instance("log", log, Log)}
    for name, each in logs.items():
        instance(f"log[{name!r}]", each, Log)
    if robot is not None:
        instance("robot", robot, Robot)
    if certificate is not None:
        instance("certificate", certificate, Certificate)
        if len(logs) > 1:
            raise InvalidArgumentError("certificate", "is of one law, and there are several runs")
    every = positive("rate", rate)
    shown = []
    for name, each in logs.items():
        stage = Stage.of(each, robot)
        shown.append(ShownRun(stage, frames_of(each, stage, every), str(name)))
    return page(shown, script=script, certificate=certificate)


def frames_of(log: Log, stage: Stage, rate: float) -> Array:
    """Return frames at even times, the last sample included, shape (frames, columns)."""
    start, end = float(log.time[0]), float(log.time[-1])
    count = min(LARGEST, max(2, round((end - start) * rate) + 1))
    rows = np.unique(np.searchsorted(log.time, np.linspace(start, end, count) - 1e-9).clip(0, len(log.time) - 1))
    return np.array([stage.frame(log.time[k], log.position[k], log.row(k)) for k in rows])
