"""The reproduction in one command: resumed, deterministic, and a report whose links lead somewhere."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest

from phcontrol import DataFileError, UnknownNameError
from phcontrol._files import write_json
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.runs.task_folder import DONE, finish, take
from phcontrol.thesis import reproduce as module
from phcontrol.thesis import versions
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.report import report
from phcontrol.thesis.reproduce import reproduce, task_names
from phcontrol.thesis.task import certificates

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
    monkeypatch.setattr(versions, "__version__", "0.0.0")
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


# --- folders of the user's own, and results that are not whole --------------------------------------

ARM = "certificates-pera_gripper"


@pytest.fixture
def copy(done, tmp_path):
    """A reproduction that was finished, to be spoiled."""
    shutil.copytree(done[0], tmp_path / "thesis")
    assert all(module._finished(tmp_path / "thesis" / name) for name in TASKS)
    return tmp_path / "thesis"


def test_a_folder_of_the_users_own_is_left_as_it_is(tmp_path):
    (tmp_path / ARM / "photos").mkdir(parents=True)
    (tmp_path / ARM / "photos" / "one.txt").write_text("mine")
    (tmp_path / ARM / DONE).write_text("mine too")
    result = reproduce(tmp_path, only=[ARM], progress=False)
    assert not result.passed
    assert f"holds {DONE}, and was not made by phcontrol reproduce" in result.results["failed"][ARM]
    assert (tmp_path / ARM / "photos" / "one.txt").read_text() == "mine"
    assert (tmp_path / ARM / DONE).read_text() == "mine too"
    assert sorted(os.listdir(tmp_path / ARM)) == [DONE, "photos"]


@pytest.mark.parametrize("name", ["index.html", "claims.json"])
def test_a_page_of_the_users_own_is_not_replaced(tmp_path, name):
    (tmp_path / name).write_text("mine")
    with pytest.raises(DataFileError, match=f"holds {name}, and was not made by phcontrol reproduce"):
        reproduce(tmp_path, only=[ARM], progress=False)
    assert os.listdir(tmp_path) == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_tasks_run_the_code_of_this_process_wherever_it_is(tmp_path, monkeypatch):
    """A folder named phcontrol in the working directory, another version perhaps, is nobody's code."""
    (tmp_path / "phcontrol").mkdir()
    (tmp_path / "phcontrol" / "__init__.py").write_text("raise SystemExit('another phcontrol')")
    monkeypatch.chdir(tmp_path)
    result = reproduce("out", only=[ARM], progress=False)
    assert result.results["failed"] == {}
    assert result.passed


def test_what_the_user_puts_into_a_tasks_folder_stays(copy):
    (copy / ARM / "notes.txt").write_text("mine")
    (copy / ARM / "photos").mkdir()
    result = reproduce(copy, only=[ARM], fresh=True, progress=False)
    assert result.passed
    assert (copy / ARM / "notes.txt").read_text() == "mine"
    assert (copy / ARM / "photos").is_dir()


@pytest.mark.parametrize("there", ["an empty folder", "our own results", "nothing"])
def test_links_are_not_written_through(done, tmp_path, there):
    out, other = tmp_path / "out", tmp_path / "other"
    out.mkdir()
    if there == "our own results":
        shutil.copytree(done[0] / ARM, other)
    elif there == "an empty folder":
        other.mkdir()
    (out / ARM).symlink_to(other)
    before = sorted(os.listdir(other)) if other.exists() else None
    result = reproduce(out, only=[ARM], progress=False)
    assert "is a link or a file" in result.results["failed"][ARM]
    assert (sorted(os.listdir(other)) if other.exists() else None) == before
    assert not result.passed


def test_a_link_in_a_folder_is_replaced_and_not_written_through(copy):
    mine = copy.parent / "mine.json"
    mine.write_text((copy / ARM / "certificates.json").read_text())
    content = mine.read_text()
    (copy / ARM / "certificates.json").unlink()
    (copy / ARM / "certificates.json").symlink_to(mine)
    (copy / "index.html").unlink()
    (copy / "index.html").symlink_to(mine)
    assert not module._finished(copy / ARM)
    result = reproduce(copy, only=[ARM], progress=False)
    assert result.run == (ARM,)
    assert mine.read_text() == content
    assert not (copy / ARM / "certificates.json").is_symlink()
    assert not (copy / "index.html").is_symlink()


def spoil(folder, name, content):
    path = folder / name
    path.unlink()
    if content is os.mkfifo:
        os.mkfifo(path)
    elif isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[" * 100_000, b"\xff\xfe", [], 5, None, {}, {"versions": module.versions()}, os.mkfifo,
     {"versions": module.versions(), "files": {}}, {"versions": module.versions(), "files": 5},
     {"versions": module.versions(), "files": {"../../secret": "x"}}],
)  # fmt: skip
def test_a_done_file_that_is_none_is_not_believed(copy, content):
    for name in (ARM, "fig-2-3"):
        spoil(copy / name, DONE, content)
        assert not module._finished(copy / name)


@pytest.mark.parametrize("content", [b"", [], [{}], 5, None, [{"law": "x", "robot": "y", "passed": True}], os.mkfifo])
@pytest.mark.parametrize(
    ("task", "name"), [(ARM, "certificates.json"), ("fig-2-3", "claims.json"), ("fig-4-1", "thesis.npz")]
)
def test_results_that_were_changed_are_not_believed(copy, task, name, content):
    spoil(copy / task, name, content)
    assert not module._finished(copy / task)


def test_one_changed_letter_is_found_and_done_again(copy, done):
    for task, name, old, new in ((ARM, "certificates.json", "true", "true "), ("fig-2-3", "claims.json", "1", "2")):
        content = (copy / task / name).read_text()
        assert old in content
        (copy / task / name).write_text(content.replace(old, new, 1))
    result = reproduce(copy, only=TASKS, progress=False)
    assert set(result.run) == {ARM, "fig-2-3"}
    assert result.results == done[1].results


def sealed(folder, name, **changes):
    """Finish a task by hand, with hashes that fit."""
    done = json.loads((folder / DONE).read_text()) | changes
    files = [folder / file for file in done.pop("files")]
    done.pop("sha256")
    finish(folder, name, files, done)


@pytest.mark.parametrize("rows", [[], {}, [5], [{"law": "x"}], "one law left out", "one form left out", "none passed"])
def test_certificates_that_are_not_all_there_are_not_believed(copy, rows):
    """Also when the hashes fit."""
    path = copy / ARM / "certificates.json"
    whole = json.loads(path.read_text())
    if rows == "one law left out":
        rows = [row for row in whole if row["law"] != "energy_shaping"]
    elif rows == "one form left out":
        rows = [row for row in whole if (row["law"], row["interconnection"]) != ("energy_shaping", "canonical")]
    elif rows == "none passed":
        rows = [{"law": law, "interconnection": "any", "not_for_it": "x", "robot": "y"} for law in CONTROLLERS]
    path.write_text(json.dumps(rows))
    sealed(copy / ARM, ARM)
    assert not module._finished(copy / ARM)


@pytest.mark.parametrize(
    "changes", [{"figures": None}, {"figures": ["other"]}, {"logs": "thesis"}, {"recordings": [1]}]
)
def test_studies_that_are_not_whole_are_not_believed(copy, changes):
    sealed(copy / "fig-4-1", "fig-4-1")
    assert module._finished(copy / "fig-4-1")
    sealed(copy / "fig-4-1", "fig-4-1", **changes)
    assert not module._finished(copy / "fig-4-1")


def test_the_folder_of_one_task_is_not_that_of_another(copy):
    shutil.rmtree(copy / "fig-2-3")
    shutil.copytree(copy / "fig-4-1", copy / "fig-2-3")
    assert not module._finished(copy / "fig-2-3")


def test_no_certificate_is_no_success(tmp_path, monkeypatch):
    """A task that ends well and leaves nothing has failed; one that was not asked for is not counted."""

    def leave_nothing(names, folder, workers, disable):
        for name in names:
            take(folder / name, name)
            files = [write_json(folder / name / "certificates.json", [])]
            finish(folder / name, name, files, {"versions": versions.versions()})
        return {}

    monkeypatch.setattr(module, "_run_all", leave_nothing)
    result = reproduce(tmp_path, only=[ARM], progress=False)
    assert not result.passed
    assert "FAILED: certificates-pera_gripper" in result.summary()
    assert "no study was asked for" in result.summary()


def test_unknown_tasks_are_listed(tmp_path):
    with pytest.raises(UnknownNameError, match=r"unknown study 'fig-9'.*certificates-pera.*fig-2-3"):
        reproduce(tmp_path, only=["fig-9"])
    names = task_names()
    assert len(set(names)) == len(names)
    figures = [name for name in names if name.startswith("fig-")]
    assert names[: len(figures)] == figures
    assert figures.index("fig-2-3") < figures.index("fig-3-1") < figures.index("fig-4-2") < figures.index("fig-4-10")


def test_text_from_studies_cannot_break_the_page():
    finding = Finding((np.inf,), chosen="<u>")
    claim = Claim("n", "<script>", Origin.TEXT, "<s>", (1.0,), "<", 0.1, [finding], "=", "<q>")
    study = {
        "study": "x", "title": "<b>title</b>", "notes": ["a & b"], "figures": ["f"], "logs": [], "recordings": [],
        "seeds": {}, "claims": [claim.to_dict()],
    }  # fmt: skip
    page = report({"versions": {}, "studies": [study], "certificates": [], "failed": {}})
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "never" in page
    assert not any(tag in page for tag in ("<s>", "<u>", "<q>", "<b>title"))


@pytest.mark.browser
def test_the_report_in_a_browser(browser, done):
    folder, _ = done
    with browser.open((folder / "index.html").as_uri(), ready=None) as page:
        assert page.locator(".figure img").count() == 2
        for image in page.locator(".figure img").all():
            image.scroll_into_view_if_needed()  # they load when they come into view
        page.wait_for_function("[...document.images].every((image) => image.complete && image.naturalWidth > 500)")
        assert page.locator(".claim.mended:visible").count() == 4
        page.check("#only-bad")
        assert page.locator(".claim.mended:visible").count() == 0
        assert page.locator(".claim.bad:visible").count() == 1
        page.check("#only-all")
        for width, columns in (
            (1400, 2),
            (700, 1),
        ):  # side by side where there is room
            page.set_viewport_size({"width": width, "height": 800})
            lefts = {round(page.locator(part).first.bounding_box()["x"]) for part in (".figures", ".claims")}
            assert len(lefts) == columns
            assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        assert page.problems == []
        page.click("summary:has-text('runs')")
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
