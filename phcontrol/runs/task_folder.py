"""The folder of a task: whose it is, and whether what is in it is whole.

A folder is written into only if a reproduction made it, which its mark says, or if it was empty; nothing is removed
from it but files that a task listed as its own. ``done.json``, written last, has a hash of every file and of itself:
what was changed, cut short or made by hand is found and done again. That is no proof against someone who computes the
hashes anew.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from phcontrol._files import make_folder, open_regular, write_json, write_text
from phcontrol.exceptions import DataFileError

DONE = "done.json"
"""Written last in a task's folder: a folder without it is of a task that was not finished."""
MARK = ".phcontrol"
"""Written first in a folder that a reproduction made."""
LARGEST = 1 << 24
"""Bytes of a JSON file that is read back."""


def take(folder: Path, name: str, own: Sequence[str] | None = None) -> None:
    """Make a folder that is a task's, or find that it is.

    Raises DataFileError for a link, a file, and a folder that holds something and was not made for this; of a folder
    where only the files ``own`` matter, for one that holds one of them.
    """
    try:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise DataFileError(f"{folder} is a link or a file: move it away")
        make_folder(folder)
        held = {item for item in os.listdir(folder) if not item.endswith(".part")}  # of one that was killed
    except OSError as error:
        raise DataFileError(f"cannot write to {folder}: {error.strerror or error}") from error
    if is_ours(folder, name):
        return
    foreign = sorted(held if own is None else held & set(own))
    if foreign:
        raise DataFileError(
            f"{folder} holds {foreign[0]}, and was not made by phcontrol reproduce: move it, or give another folder"
        )
    write_text(folder / MARK, _mark(name))


def is_ours(folder: Path, name: str) -> bool:
    """Return whether a reproduction made a folder for a task."""
    try:
        return _is_folder(folder) and _read(folder / MARK) == _mark(name).encode()
    except DataFileError:
        return False


def clear(folder: Path, name: str) -> None:
    """Remove what an earlier run of a task listed as its own, its ``done.json`` first; from no other folder."""
    if not is_ours(folder, name):
        return
    try:
        done = json.loads(_read(folder / DONE))
        files = list(done["files"])
    except (DataFileError, ValueError, KeyError, TypeError, RecursionError):
        files = []
    for file in (DONE, *filter(_is_plain, files)):
        if file != MARK and _is_file(folder / file):
            (folder / file).unlink()


def finish(folder: Path, name: str, files: Sequence[Path], content: Mapping[str, Any]) -> None:
    """Write ``done.json``: the content, and hashes of the files that the task wrote."""
    done = dict(content) | {"files": {file.name: _hash_of(file) for file in files}}
    write_json(folder / DONE, done | {"sha256": _seal(name, done)})


def read_done(folder: Path, name: str) -> dict[str, Any]:
    """Return what a finished task's ``done.json`` holds. Raises DataFileError unless all its files are whole."""
    if not is_ours(folder, name):
        raise DataFileError(f"{folder} was not made by phcontrol reproduce")
    done = read_json(folder / DONE)
    if not isinstance(done, dict) or not isinstance(done.get("files"), dict):
        raise DataFileError(f"{folder / DONE} is not one")
    if done.pop("sha256", None) != _seal(name, done):
        raise DataFileError(f"{folder / DONE} was changed")
    for file, expected in done["files"].items():
        if not _is_plain(file) or _hash_of(folder / file) != expected:
            raise DataFileError(f"{folder / file} was changed")
    return done


def read_json(path: Path) -> Any:
    """Return the content of a JSON file of ours. Raises DataFileError."""
    try:
        return json.loads(_read(path))
    except (ValueError, RecursionError) as error:
        raise DataFileError(f"cannot read {path}: {error}") from error


def _mark(name: str) -> str:
    return f"made by phcontrol reproduce: {name}\n"


def _read(path: Path) -> bytes:
    with open_regular(path, follow_links=False) as file:
        content = file.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise DataFileError(f"cannot read {path}: it is too large")
    return content


def _hash_of(path: Path) -> str:
    digest = hashlib.sha256()
    with open_regular(path, follow_links=False) as file:
        while part := file.read(1 << 20):
            digest.update(part)
    return digest.hexdigest()


def _seal(name: str, done: Mapping[str, Any]) -> str:
    return hashlib.sha256(f"{name}\n{json.dumps(done, sort_keys=True)}".encode()).hexdigest()


def _is_plain(file: object) -> bool:
    return isinstance(file, str) and file == os.path.basename(file) and file not in ("", ".", "..")


def _is_file(path: Path) -> bool:
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except (OSError, ValueError):
        return False


def _is_folder(path: Path) -> bool:
    try:
        return stat.S_ISDIR(path.lstat().st_mode)
    except (OSError, ValueError):
        return False
