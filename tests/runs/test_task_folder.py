"""A task's folder: what is whole is read back, what was changed is not believed, and only what is its own goes."""

from __future__ import annotations

import json

import pytest

from phcontrol import DataFileError
from phcontrol.runs import task_folder
from phcontrol.runs.task_folder import DONE, MARK, clear, finish, read_done, take


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "task"
    take(place, "a task")
    (place / "result.csv").write_text("1,2\n")
    (place / "letter.txt").write_text("keep me")
    finish(place, "a task", [place / "result.csv"], {"seconds": 3.0})
    return place


def test_what_is_whole_is_read_back(folder):
    assert read_done(folder, "a task")["seconds"] == 3.0
    with pytest.raises(DataFileError, match="was not made by"):
        read_done(folder, "another task")


def test_what_was_changed_is_not_believed(folder):
    (folder / "result.csv").write_text("1,3\n")
    with pytest.raises(DataFileError, match=r"result\.csv was changed"):
        read_done(folder, "a task")
    done = json.loads((folder / DONE).read_text())
    (folder / DONE).write_text(json.dumps(done | {"seconds": 1.0}))
    with pytest.raises(DataFileError, match=r"done\.json was changed"):
        read_done(folder, "a task")


def test_what_is_its_own_is_removed_and_nothing_else(folder):
    clear(folder, "another task")
    assert (folder / DONE).is_file()
    clear(folder, "a task")
    assert sorted(path.name for path in folder.iterdir()) == sorted([MARK, "letter.txt"])


def test_a_file_that_is_too_large_is_not_read(folder, monkeypatch):
    size = (folder / DONE).stat().st_size
    monkeypatch.setattr(task_folder, "LARGEST", size)
    read_done(folder, "a task")
    monkeypatch.setattr(task_folder, "LARGEST", size - 1)
    with pytest.raises(DataFileError, match="too large"):
        read_done(folder, "a task")
