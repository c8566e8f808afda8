"""Every study and every certificate, in parallel processes, into one report that can be trusted."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import scipy
from tqdm import tqdm

from phcontrol._files import write_json, write_text
from phcontrol._validation import choice, count, flag
from phcontrol._version import __version__
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.exceptions import DataFileError
from phcontrol.runs.task_folder import clear, read_done, read_json, take
from phcontrol.thesis.grasping_readings import grasping_by_reading
from phcontrol.thesis.registry import STUDIES
from phcontrol.thesis.tally import Tally

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


def versions() -> dict[str, str]:
    """Return the versions that numbers depend on."""
    return {
        "phcontrol": __version__,
        "pinocchio": pin.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }


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
    """Run tasks in processes; return the reasons of those that failed."""
    # what takes longest begins first: the studies of our own are wider than the thesis's figures
    order = sorted(names, key=_is_figure)
    running: set[subprocess.Popen[str]] = set()
    failed: dict[str, str] = {}
    pool = ThreadPoolExecutor(workers)
    try:
        futures: dict[Future[str], str] = {pool.submit(_run_task, name, folder, running): name for name in order}
        with tqdm(total=len(names), unit="task", disable=disable, leave=False) as bar:
            for future in as_completed(futures):
                if future.result():
                    failed[futures[future]] = future.result()
                bar.set_postfix_str(futures[future])
                bar.update()
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in list(running):
            process.terminate()
        raise
    finally:
        pool.shutdown()
    return failed


def _run_task(name: str, folder: Path, running: set[subprocess.Popen[str]]) -> str:
    """Run one task in a process of its own; return why it failed, or nothing."""
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    # the modules of this process, never those of a folder that it happens to be run in
    code = f"import sys; sys.path[:] = {sys.path!r}; from phcontrol.thesis.task import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, name, str(folder / name), str(os.getpid())],
        env=os.environ | one_thread,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # the keyboard's interrupt is ours to pass on
    )
    running.add(process)
    complaints = process.communicate()[1]
    running.discard(process)
    if process.returncode == 0:
        return ""
    lines = complaints.strip().splitlines()
    return lines[-1] if lines else f"ended with code {process.returncode}"


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
