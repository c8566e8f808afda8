"""One task of a reproduction, in a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from phcontrol._files import write_json, write_text
from phcontrol.analysis.certify import certify
from phcontrol.controllers.registry import CONTROLLERS, make_controller
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.task_folder import clear, finish, take
from phcontrol.thesis.registry import STUDIES, run_study
from phcontrol.thesis.versions import versions
from phcontrol.visualization.page import meshcat_script
from phcontrol.visualization.recording import recorded_page


class Task(NamedTuple):
    """What a process is given."""

    name: str
    """Of a study, or "certificates-ARM"."""
    folder: Path


def run_task(task: Task) -> None:
    """Run a study or an arm's certificates, and write what came of it; the mark that it is done comes last.

    Raises DataFileError where the folder is not a task's.
    """
    name, folder = task
    take(folder, name)
    clear(folder, name)
    if name in STUDIES:
        files, content = _study(name, folder)
    else:
        rows = certificates(name.removeprefix("certificates-"))
        files, content = [write_json(folder / "certificates.json", rows)], {}
    finish(folder, name, files, {"versions": versions()} | content)


def _study(name: str, folder: Path) -> tuple[list[Path], dict[str, Any]]:
    outcome = run_study(name)
    files = [*outcome.write(folder), write_text(folder / "meshcat.js", meshcat_script())]
    recordings = []
    for log_name, log in outcome.logs.items():
        files.append(write_text(folder / f"{log_name}.html", recorded_page(log, script="meshcat.js")))
        recordings.append(log_name)
    seeds = {log_name: log.metadata["seeds"] for log_name, log in outcome.logs.items() if log.metadata.get("seeds")}
    content = {"figures": list(outcome.figures), "logs": list(outcome.logs), "recordings": recordings, "seeds": seeds}
    return files, content


def certificates(robot: str) -> list[dict[str, Any]]:
    """Return the certificate of every law in every form on an arm; of a law that is not for it, the reason."""
    system = MechanicalSystem(load_robot(robot))
    rows: list[dict[str, Any]] = []
    for law, entry in CONTROLLERS.items():
        for form in entry.law.forms:
            try:
                controller = make_controller(law, system, interconnection=form)
            except InvalidArgumentError as error:
                rows.append({"law": law, "robot": robot, "interconnection": "any", "not_for_it": str(error)})
                break
            rows.append({"law": law} | certify(controller, system).to_dict())
    return rows
