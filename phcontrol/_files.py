"""Files: written so that nothing is lost, and opened so that nothing hangs."""

from __future__ import annotations

import errno
import json
import os
import secrets
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from phcontrol._validation import file_path
from phcontrol.exceptions import DataFileError


def write_atomically(path: str | os.PathLike[str], write: Callable[[IO[bytes]], None]) -> Path:
    """Let ``write`` fill a temporary file beside ``path``, then move it into place: the whole new file, or the old one.

    The folder is made as ``make_folder`` allows. A link at ``path`` is replaced, not written through; a folder, pipe
    or device there is refused. Raises DataFileError, and leaves no partial file, when the disk is full or the place
    is not writable.
    """
    target = file_path("path", path)
    temporary: Path | None = None
    try:
        make_folder(target.parent)
        _check_replaceable(target)
        partial = target.parent / f".{secrets.token_hex(8)}.part"
        descriptor = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
        temporary = partial
        with os.fdopen(descriptor, "w+b") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
        temporary = None
    except (OSError, UnicodeEncodeError) as error:
        raise DataFileError(f"cannot write {target}: {_reason(error)}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return target


def write_whole(path: str | os.PathLike[str], write: Callable[[Path], None]) -> Path:
    """Let ``write`` make a file at a place of its own beside ``path``, then move it there: for programs that open
    files themselves.

    Raises as ``write_atomically`` does.
    """  # noqa: D205
    target = file_path("path", path)
    check_file_place(target)
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".", suffix=".part") as folder:
            made = Path(folder, target.name)
            write(made)
            with open(made, "rb") as file:
                os.fsync(file.fileno())
            os.replace(made, target)
    except OSError as error:
        raise DataFileError(f"cannot write {target}: {_reason(error)}") from error
    return target


def make_folder(folder: str | os.PathLike[str]) -> None:
    """Make a folder that is not there yet: a mistyped path shall be an error rather than a new tree of folders.

    Below the working directory it is made as deep as asked; elsewhere only the last level is, and none in the root of
    the file system. Raises OSError.
    """
    if "\0" in os.fspath(folder):
        raise OSError(errno.EINVAL, "a path cannot hold a NUL")
    place, here = Path(os.path.abspath(folder)), Path.cwd()
    if place.is_dir():
        return
    root = Path(place.anchor)
    inside = here != root and place.is_relative_to(here)
    if not inside and place.parent == root:
        raise OSError(errno.ENOENT, f"there is no folder {place}, and none is made in the root of the file system")
    if not inside and not place.parent.is_dir():
        raise OSError(errno.ENOENT, f"there is no folder {place.parent} to make {place.name} in")
    place.mkdir(parents=inside, exist_ok=True)


def check_file_place(path: str | os.PathLike[str]) -> None:
    """Find out before a long run, not after it, that a file cannot be written. Raises DataFileError."""
    target = file_path("path", path)
    try:
        check_folder(target.parent)
        _check_replaceable(target)
    except OSError as error:
        raise DataFileError(f"cannot write {path}: {_reason(error)}") from error


def check_folder(folder: str | os.PathLike[str]) -> None:
    """Make a folder where it is not there, and find out whether one can write into it. Raises OSError."""
    make_folder(folder)
    with tempfile.TemporaryFile(dir=folder):
        pass


def open_regular(path: str | os.PathLike[str], *, follow_links: bool = True) -> IO[bytes]:
    """Open a file for reading; a pipe, device or folder is refused, where opening or reading might never end.

    Raises DataFileError.
    """
    path = file_path("path", path)
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
    if not follow_links:
        flags |= getattr(os, "O_NOFOLLOW", 0)
    try:
        descriptor = os.open(path, flags)
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise OSError(errno.EINVAL, "it is not a regular file")
    except (OSError, ValueError) as error:
        raise DataFileError(f"cannot read {path}: {_reason(error)}") from error
    return os.fdopen(descriptor, "rb")


def write_json(path: str | os.PathLike[str], data: Any) -> Path:
    """Write ``data`` as indented JSON, atomically. Infinities and NaN are refused."""
    return write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text file in UTF-8, atomically."""
    return write_atomically(path, lambda file: _write_all(file, text.encode()))


def _write_all(file: IO[bytes], content: bytes) -> None:
    file.write(content)


def _check_replaceable(target: Path) -> None:
    """Raise OSError for a place that holds something that a file must not replace."""
    try:
        mode = target.lstat().st_mode
    except FileNotFoundError:
        return
    if not (stat.S_ISREG(mode) or stat.S_ISLNK(mode)):
        raise OSError(errno.EINVAL, "it is a folder" if stat.S_ISDIR(mode) else "it is a pipe or a device")


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
