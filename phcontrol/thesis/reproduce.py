"""Every study and every certificate, in parallel processes, into one report that can be trusted."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from phcontrol._files import write_json, write_text
from phcontrol._validation import choice, count, flag
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.exceptions import DataFileError
from phcontrol.runs.task_folder import clear, read_done, read_json, take
from phcontrol.sweeps.engine import EngineError
from phcontrol.sweeps.local_processes import LocalProcesses
from phcontrol.thesis.grasping_readings import grasping_by_reading
from phcontrol.thesis.registry import STUDIES
from phcontrol.thesis.tally import Tally
from phcontrol.thesis.task import Task, run_task
from phcontrol.thesis.versions import versions

CERTIFIED = ("pera", "pera_shoulder_elbow", "pera_shoulder", "pera_gripper")
"""The thesis's arms; each is one task, "certificates-NAME"."""
REPORT, CLAIMS = "index.html", "claims.json"
"""What is written beside the tasks' folders."""


@dataclass(frozen=True)
class Reproduction:
    """What came of ``reproduce``."""

    report: Path
    results: dict[str, Any]
    """What ``claims.json`` holds."""
    run: tuple[str, ...]
    """Tasks that ran now."""
    kept: tuple[str, ...]
    """Tasks whose results were there."""

    @property
    def passed(self) -> bool:
        """Whether every task ran to its end and every certificate passed; a claim may still be not reproduced."""
        return not self.results["failed"] and all(
            row["passed"] for row in self.results["certificates"] if "passed" in row
        )

    def summary(self) -> str:
        """Return how many claims were reproduced and how many certificates passed, in a few lines."""
        claims = [claim for study in self.results["studies"] for claim in study["claims"]]
        theirs, ours, measured = Tally.of_the_thesis(claims), Tally.of_ours(claims), Tally.of_stand_ins(claims)
        rows = [row for row in self.results["certificates"] if "passed" in row]
        tasks = (*self.run, *self.kept)
        lines = [
            f"the thesis's claims: {theirs.reproduced} of {theirs.total} reproduced ({theirs.by_verdict})\n"
            "what it measured on the arm, for which simulations stand in: "
            f"{measured.reproduced} of {measured.total} ({measured.by_verdict})\n"
            f"our own claims: {ours.reproduced} of {ours.total} met"
            if any(name in STUDIES for name in tasks)
            else "no study was asked for",
            *(f"  under {text}" for text in grasping_by_reading(self.results["studies"])),
            f"{len(rows)} certificates: {sum(row['passed'] for row in rows)} passed"
            if any(name not in STUDIES for name in tasks)
            else "no certificate was asked for",
            *(f"FAILED: {name}: {reason}" for name, reason in self.results["failed"].items()),
        ]
        return "\n".join(lines)


def task_names() -> list[str]:
    """Return what can be reproduced: the thesis's figures in its order, our own studies, certificates of each arm."""
    figures = sorted((name for name in STUDIES if _is_figure(name)), key=_number)
    own = [name for name in STUDIES if not _is_figure(name)]
    return [*figures, *own, *(f"certificates-{robot}" for robot in CERTIFIED)]


def _is_figure(name: str) -> bool:
    return name.startswith("fig-")


def _number(figure: str) -> list[int]:
    """Return 4, 10 of "fig-4-10"."""
    return [int(part) for part in figure.split("-")[1:]]


def reproduce(
    directory: str | os.PathLike[str],
    *,
    only: Sequence[str] | None = None,
    fresh: bool = False,
    jobs: int | None = None,
    progress: bool | None = None,
) -> Reproduction:
    """Run every study and certificate that is not there yet, and write ``index.html`` and ``claims.json``.

    Each task is a process of its own with one thread, so that numbers do not depend on how many run at once. A task
    whose folder is finished, by the same versions, is not run again: an interrupted reproduction goes on where it
    was, and loses only what was running. What was changed since it was written is run again. A folder that holds
    anything, and was not made by a reproduction, is left as it is: its task fails.

    Args:
        directory: of the results.
        only: names of tasks (see ``task_names``); by default all.
        fresh: run tasks again whose results are there.
        jobs: processes at a time; by default as many as there are processors.
        progress: show a progress bar; by default only on a terminal.

    Raises:
        UnknownNameError: no task of that name; lists those that exist.
        DataFileError: the directory cannot be written, or has an ``index.html`` or ``claims.json`` of another origin.
        KeyboardInterrupt: stopped from the keyboard; what was finished is kept.
    """
    folder = Path(directory)
    wanted = list(dict.fromkeys(choice("study", name, task_names()) for name in only)) if only else task_names()
    wanted.sort(key=task_names().index)
    workers = os.cpu_count() or 1 if jobs is None else count("jobs", jobs)
    take(folder, "report", own=(REPORT, CLAIMS))
    kept = [] if flag("fresh", fresh) else [name for name in wanted if _finished(folder / name)]
    due = [name for name in wanted if name not in kept]
    for name in due:
        clear(folder / name, name)
    failed = _run_all(due, folder, workers, None if progress is None else not progress)
    results = _collect(wanted, folder, failed)
    from phcontrol.thesis.report import report

    write_json(folder / CLAIMS, results)
    page = write_text(folder / REPORT, report(results))
    return Reproduction(page, results, tuple(due), tuple(kept))


def _finished(folder: Path) -> bool:
    try:
        read_results(folder)
    except DataFileError:
        return False
    return True


def read_results(folder: Path) -> dict[str, Any]:
    """Return what a finished task found, of this very version: "study" or "certificates".

    Raises DataFileError where it is not whole: a study without claims, an arm without the certificates of all laws.
    """
    name = folder.name
    done = read_done(folder, name)
    if done.get("versions") != versions():
        raise DataFileError(f"{folder} is of other versions")
    if name not in STUDIES:
        rows = _listed(folder, done, "certificates.json")
        _check_certificates(rows, folder)
        return {"certificates": rows}
    claims = _listed(folder, done, "claims.json")
    parts = {key: done.get(key) for key in ("figures", "logs", "recordings", "seeds")}
    if not isinstance(claims, dict) or claims.get("study") != name or not claims.get("claims"):
        raise DataFileError(f"{folder} has no claims")
    for key, ending in (("figures", "png"), ("logs", "npz"), ("recordings", "html")):
        items = parts[key]
        if not isinstance(items, list) or any(f"{item}.{ending}" not in done["files"] for item in items):
            raise DataFileError(f"{folder} lacks some of its {key}")
    return {"study": claims | parts}


def _listed(folder: Path, done: dict[str, Any], file: str) -> Any:
    if file not in done["files"]:
        raise DataFileError(f"{folder} has no {file}")
    return read_json(folder / file)


def _check_certificates(rows: Any, folder: Path) -> None:
    """Raise DataFileError unless there is a certificate of each law in each form, or the reason why there is none."""
    whole = isinstance(rows, list) and all(isinstance(row, dict) for row in rows)
    found = {(row.get("law"), row.get("interconnection")): row for row in rows} if whole else {}
    for law, entry in CONTROLLERS.items():
        forms = [found.get((law, form), {}).get("passed") for form in entry.law.forms]
        if (law, "any") not in found and not all(isinstance(passed, bool) for passed in forms):
            raise DataFileError(f"{folder} lacks certificates of {law}")
    if not any("passed" in row for row in found.values()):
        raise DataFileError(f"{folder} has no certificate")


def _run_all(names: list[str], folder: Path, workers: int, disable: bool | None) -> dict[str, str]:
    """Run tasks, each in a process of its own; return the reasons of those that failed."""
    # what takes longest begins first: the studies of our own are wider than the thesis's figures
    tasks = [Task(name, folder.absolute() / name) for name in sorted(names, key=_is_figure)]
    failed: dict[str, str] = {}
    engine = LocalProcesses(workers, fresh=True, attempts=1)
    with (
        tqdm(total=len(names), unit="task", disable=disable, leave=False) as bar,
        contextlib.closing(engine.run(run_task, tasks)) as running,
    ):
        for done in running:
            if done.error is not None:
                kind = "" if isinstance(done.error, EngineError) else f"{type(done.error).__name__}: "
                failed[done.item.name] = kind + " ".join(str(done.error).split())
            bar.set_postfix_str(done.item.name)
            bar.update()
    return failed


def _collect(names: list[str], folder: Path, failed: dict[str, str]) -> dict[str, Any]:
    """Return everything that the tasks found: nothing in it depends on when or how fast they ran."""
    studies, certificates = [], []
    for name in names:
        if name in failed:
            continue
        try:
            found = read_results(folder / name)
        except DataFileError as error:
            failed[name] = str(error)
            continue
        if "study" in found:
            studies.append(found["study"])
        else:
            certificates += found["certificates"]
    return {"versions": versions(), "studies": studies, "certificates": certificates, "failed": failed}
