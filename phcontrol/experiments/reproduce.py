"""Every study and every certificate, in parallel processes, into one report that can be trusted."""

from __future__ import annotations

import contextlib
import json
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
from phcontrol._validation import choice, count
from phcontrol._version import __version__
from phcontrol.exceptions import DataFileError
from phcontrol.experiments.registry import STUDIES

CERTIFIED = ("pera", "pera_shoulder_elbow", "pera_shoulder", "pera_gripper")
"""The thesis's arms; each is one task, "certificates-NAME"."""
DONE = "done.json"
"""Written last in a task's folder: a folder without it is of a task that was not finished."""


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
        verdicts = [claim["verdict"] for study in self.results["studies"] for claim in study["claims"]]
        rows = [row for row in self.results["certificates"] if "passed" in row]
        lines = [
            f"{len(verdicts)} claims: {verdicts.count('reproduced')} reproduced as printed, "
            f"{sum(verdict.startswith('reproduced with') for verdict in verdicts)} with a correction, "
            f"{verdicts.count('not reproduced')} not reproduced",
            f"{len(rows)} certificates: {sum(row['passed'] for row in rows)} passed",
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
    was, and loses only what was running.

    Args:
        directory: of the results.
        only: names of tasks (see ``task_names``); by default all.
        fresh: run tasks again whose results are there.
        jobs: processes at a time; by default as many as there are processors.
        progress: show a progress bar; by default only on a terminal.

    Raises:
        UnknownNameError: no task of that name; lists those that exist.
        DataFileError: the directory cannot be written.
        KeyboardInterrupt: stopped from the keyboard; what was finished is kept.
    """
    folder = Path(directory)
    wanted = list(dict.fromkeys(choice("study", name, task_names()) for name in only)) if only else task_names()
    wanted.sort(key=task_names().index)
    workers = os.cpu_count() or 1 if jobs is None else count("jobs", jobs)
    kept = [] if fresh else [name for name in wanted if _finished(folder / name)]
    due = [name for name in wanted if name not in kept]
    for name in due:
        with contextlib.suppress(OSError):
            (folder / name / DONE).unlink()
    failed = _run_all(due, folder, workers, None if progress is None else not progress)
    results = _collect(wanted, folder, failed)
    from phcontrol.experiments.report import report

    write_json(folder / "claims.json", results)
    page = write_text(folder / "index.html", report(results))
    return Reproduction(page, results, tuple(due), tuple(kept))


def _finished(folder: Path) -> bool:
    try:
        done = json.loads((folder / DONE).read_text())
    except (OSError, ValueError):
        return False
    return bool(done.get("versions") == versions())


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
    process = subprocess.Popen(
        [sys.executable, "-m", "phcontrol.experiments.task", name, str(folder / name), str(os.getpid())],
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
            done = json.loads((folder / name / DONE).read_text())
            if name in STUDIES:
                claims = json.loads((folder / name / "claims.json").read_text())
                studies.append(claims | {key: done[key] for key in ("figures", "logs", "recordings", "seeds")})
            else:
                certificates += json.loads((folder / name / "certificates.json").read_text())
        except (OSError, ValueError, KeyError) as error:
            raise DataFileError(f"cannot read what {name} left in {folder / name}: {error}") from error
    return {"versions": versions(), "studies": studies, "certificates": certificates, "failed": failed}
