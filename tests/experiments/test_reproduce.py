"""The reproduction in one command: resumed, deterministic, and a report whose links lead somewhere."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time

import psutil
import pytest

from phcontrol import UnknownNameError
from phcontrol.experiments import reproduce as module
from phcontrol.experiments.report import report
from phcontrol.experiments.reproduce import DONE, reproduce, task_names
from phcontrol.experiments.task import certificates

TASKS = ["certificates-pera_gripper", "fig-2-3", "fig-4-1"]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("thesis")
    return folder, reproduce(folder, only=TASKS, jobs=2, progress=False)


pytestmark = pytest.mark.xdist_group("reproduce")


def test_everything_named_is_run_and_in_the_report(done):
    folder, result = done
    assert set(result.run) == set(TASKS)
    assert result.passed
    results = json.loads((folder / "claims.json").read_text())
    assert results == result.results
    assert [study["study"] for study in results["studies"]] == ["fig-2-3", "fig-4-1"]  # the thesis's order
    assert {row["robot"] for row in results["certificates"]} == {"pera_gripper"}
    page = (folder / "index.html").read_text()
    for study in results["studies"]:
        for claim in study["claims"]:
            assert claim["statement"] in page
    links = [link for link in re.findall(r'(?:href|src)="([^"#:]+)"', page) if link]
    assert "fig-4-1/thesis.npz" in links
    assert [link for link in links if not (folder / link).exists()] == []


def test_what_is_finished_is_kept_and_numbers_do_not_change(done, tmp_path):
    folder, first = done
    stamps = {name: (folder / name / DONE).stat().st_mtime_ns for name in TASKS}
    again = reproduce(folder, only=TASKS, progress=False)
    assert (again.run, set(again.kept)) == ((), set(TASKS))
    assert {name: (folder / name / DONE).stat().st_mtime_ns for name in TASKS} == stamps
    fresh = reproduce(tmp_path, only=["fig-4-1", "certificates-pera_gripper"], jobs=1, progress=False)
    for key in ("studies", "certificates"):
        kept = [entry for entry in first.results[key] if entry.get("study") != "fig-2-3"]
        assert fresh.results[key] == kept


def test_results_of_other_versions_are_run_again(done, monkeypatch):
    folder, _ = done
    assert module._finished(folder / "fig-2-3")
    monkeypatch.setattr(module, "__version__", "0.0.0")
    assert not module._finished(folder / "fig-2-3")


def test_a_killed_reproduction_loses_only_what_was_running(tmp_path):
    names = ["fig-2-3", "fig-4-1", "certificates-pera_gripper"]
    command = [sys.executable, "-m", "phcontrol.cli", "reproduce", "--out", str(tmp_path), "--jobs", "1"]
    command += [part for name in names for part in ("--only", name)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120.0
    while not list(tmp_path.glob(f"*/{DONE}")) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    output, complaints = process.communicate(timeout=60)
    finished = {path.parent.name for path in tmp_path.glob(f"*/{DONE}")}
    if process.returncode == 0:  # everything was done before the signal came
        assert finished == set(names)
        return
    assert process.returncode == 130
    assert "goes on from there" in complaints
    assert "Traceback" not in complaints
    result = reproduce(tmp_path, only=names, progress=False)
    assert set(result.kept) == finished
    assert set(result.run) == set(names) - finished


def test_tasks_end_with_a_reproduction_that_is_killed(tmp_path):
    command = [sys.executable, "-m", "phcontrol.cli", "reproduce", "--out", str(tmp_path), "--only", "fig-3-1"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    children = []
    deadline = time.monotonic() + 60.0
    while not children and time.monotonic() < deadline:
        children = psutil.Process(process.pid).children()
        time.sleep(0.05)
    time.sleep(1.0)  # the task has begun
    process.kill()
    process.wait()
    gone, alive = psutil.wait_procs(children, timeout=30)
    assert gone
    assert not alive
    assert not (tmp_path / "fig-3-1" / DONE).exists()


def test_a_task_that_fails_is_named_and_the_others_go_on(tmp_path):
    (tmp_path / "fig-2-3").write_text("in the way of the folder")
    result = reproduce(tmp_path, only=["fig-2-3", "certificates-pera_gripper"], progress=False)
    assert list(result.results["failed"]) == ["fig-2-3"]
    assert not result.passed
    assert "FAILED: fig-2-3" in result.summary()
    assert len(result.results["certificates"]) > 0
    assert "did not run to its end" in (tmp_path / "index.html").read_text()


def test_unknown_tasks_are_listed(tmp_path):
    with pytest.raises(UnknownNameError, match=r"unknown study 'fig-9'.*certificates-pera.*fig-2-3"):
        reproduce(tmp_path, only=["fig-9"])
    names = task_names()
    assert len(set(names)) == len(names)
    figures = [name for name in names if name.startswith("fig-")]
    assert names[: len(figures)] == figures
    assert figures.index("fig-2-3") < figures.index("fig-3-1") < figures.index("fig-4-2") < figures.index("fig-4-10")


def test_text_from_studies_cannot_break_the_page():
    study = {
        "study": "x", "title": "<b>title</b>", "notes": ["a & b"], "figures": ["f"], "logs": [], "recordings": [],
        "seeds": {}, "claims": [{"statement": "<script>", "source": "s", "printed": [1.0], "ours": [None], "unit": "<",
                                 "verdict": "not reproduced", "reason": "<i>", "erratum": ""}],
    }  # fmt: skip
    page = report({"versions": {}, "studies": [study], "certificates": [], "failed": {}})
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "never" in page


@pytest.mark.browser
def test_the_report_in_a_browser(browser, done):
    folder, _ = done
    with browser.open((folder / "index.html").as_uri(), ready=None) as page:
        assert page.locator(".figure img").count() == 2
        for image in page.locator(".figure img").all():
            image.scroll_into_view_if_needed()  # they load when they come into view
        page.wait_for_function("[...document.images].every((image) => image.complete && image.naturalWidth > 500)")
        assert page.locator("tr.mended:visible").count() == 5
        page.check("#only-not")
        assert page.locator("tr.mended:visible").count() == 0
        assert page.problems == []
        page.click("text=play >> nth=0")
        page.wait_for_function("window.phcontrol && phcontrol.frames > 1", timeout=60_000)
        assert page.problems == []
        assert all(request.startswith("file:") for request in page.requests)


def test_a_certificate_is_that_of_certify():
    from phcontrol import MechanicalSystem, certify, load_robot, make_controller

    system = MechanicalSystem(load_robot("pera_gripper"))
    rows = {(row["law"], row["interconnection"]): row for row in certificates("pera_gripper")}
    controller = make_controller("energy_shaping", system, interconnection="canonical")
    assert rows["energy_shaping", "canonical"] == {"law": "energy_shaping"} | certify(controller, system).to_dict()
