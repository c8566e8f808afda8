"""Compiled objects by their content, in a folder that is the user's own."""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import stat
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

from phcontrol.compilation.compiler import Compiler
from phcontrol.compilation.errors import CompilationError, CompilationWarning

LARGEST = 512 * 2**20
"""Bytes of objects in the cache; a law has about 100 kB, a loop for many runs 1 MB."""
_STALE = 3600.0  # [s]: no compiler takes longer


def cache_folder() -> Path:
    """Return where compiled objects are kept: ``PHCONTROL_CACHE``, or phcontrol in the user's folder for caches."""
    named = os.environ.get("PHCONTROL_CACHE")
    if named:
        return Path(named)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "phcontrol" / "compiled"
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "phcontrol" / "compiled"


def open_folder(folder: Path) -> Path:
    """Make the folder (0700) and return it. Raises CompilationError unless it is the user's alone.

    Code is loaded from there: a folder, or a file, that somebody else owns or may write to is refused.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise CompilationError(f"the cache {folder} cannot be made: {error.strerror or error}") from error
    problem = problem_of(folder)
    if problem:
        raise CompilationError(f"the cache {folder} is refused: {problem}; code is loaded from there")
    problem = problem_above(folder)
    if problem:
        raise CompilationError(f"the cache {folder} is refused: {problem}; code is loaded from there")
    return folder


def problem_above(folder: Path) -> str:
    """Return what is wrong with the folders above one that code is loaded from; "" for nothing.

    Who may write to one of them may put another folder in its place: where it is named, and where links lead. Folders
    in which only owners remove things (sticky, as the one for temporary files) are fine.
    """
    for parent in dict.fromkeys([*folder.absolute().parents, *folder.resolve().parents]):
        status = parent.stat()
        if status.st_uid not in (0, os.geteuid()):
            return f"{parent} above it belongs to user {status.st_uid}"
        if status.st_mode & stat.S_ISVTX:
            continue
        if status.st_mode & stat.S_IWOTH:
            return f"everybody may write to {parent}"
        own_group = status.st_gid in (0, status.st_uid)  # as systems have it that give each user one
        if status.st_mode & stat.S_IWGRP and not own_group:
            return f"group {status.st_gid} may write to {parent}"
    return ""


def problem_of(path: Path) -> str:
    """Return what is wrong with a folder or file that code is loaded from; "" for nothing."""
    status = path.lstat()
    if stat.S_ISLNK(status.st_mode):
        return "it is a symbolic link"
    if status.st_uid != os.geteuid():
        return f"it belongs to user {status.st_uid}"
    if status.st_mode & 0o077:
        return f"others may use it (mode {stat.S_IMODE(status.st_mode):04o}, should be {_wanted(status):04o})"
    return ""


def _wanted(status: os.stat_result) -> int:
    return 0o700 if stat.S_ISDIR(status.st_mode) else 0o600


def compiled(
    source: str, compiler: Compiler, *, native: bool = False, accept: Callable[[Path], object] = lambda path: None
) -> Path:
    """Return the shared object of a source: from the cache, or compiled into it.

    Its name is the hash of the source, the compiler and its options; beside it stands the hash of the object. Written
    to a file of another name first, and then renamed; ``accept`` is asked about that file before, and raises where it
    is not to be kept.

    A folder that is refused is not used: what is compiled is kept for this process only, and a CompilationWarning says
    so. The cache holds ``LARGEST`` bytes; objects that were not used for longest are removed.

    Raises:
        CompilationError: the disk is full, the compiler fails, or what it made is not accepted.
    """
    folder = _folder()
    key = hashlib.sha256(f"{compiler.identity(native)}\n{source}".encode()).hexdigest()
    target = folder / f"{key}.so"
    if target.exists() or target.is_symlink():
        problem = _fault(target)
        if not problem:
            with suppress(OSError):
                os.utime(target)  # it was used now
            return target
        warnings.warn(f"{target} of the cache is refused and made anew: {problem}", CompilationWarning, stacklevel=2)
    try:
        target.unlink(missing_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix="making-") as made:
            text, library = Path(made) / "law.c", Path(made) / "law.so"
            text.write_text(source, encoding="utf-8")
            compiler.compile(text, library, native)
            library.chmod(0o600)
            accept(library)
            digest = Path(made) / "digest"
            digest.write_text(_digest(library), encoding="ascii")
            digest.chmod(0o600)
            os.replace(digest, _beside(target))
            os.replace(library, target)
        bound(folder, LARGEST, but=target)
    except OSError as error:
        raise CompilationError(f"the cache {folder} cannot be written to: {error.strerror or error}") from error
    return target


@cache
def _own_folder() -> tempfile.TemporaryDirectory[str]:
    """Return a folder of this process, removed at its end."""
    folder = tempfile.TemporaryDirectory(prefix="phcontrol-")
    atexit.register(folder.cleanup)
    return folder


def _folder() -> Path:
    """Return the folder for objects: the cache, or where that is refused one of this process."""
    try:
        return open_folder(cache_folder())
    except CompilationError as error:
        own = Path(_own_folder().name)
        if problem_above(own):
            raise
        warnings.warn(f"compiled for this process only: {error}", CompilationWarning, stacklevel=4)
        return own


def bound(folder: Path, largest: int, *, but: Path) -> None:
    """Remove the objects that were not used for longest, until what is left is at most so many bytes.

    Args:
        folder: the cache.
        largest: bytes of all objects.
        but: an object that stays.
    """
    found: list[tuple[float, int, Path]] = []
    for path in folder.glob("*.so"):
        with suppress(OSError):  # another process may have removed it
            status = path.lstat()
            found.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in found)
    for _, size, path in sorted(found):
        if total <= largest:
            break
        if path != but:
            discard(path)
            total -= size
    for path in folder.glob("making-*"):  # of a process that was killed
        with suppress(OSError):
            if time.time() - path.lstat().st_mtime > _STALE:
                shutil.rmtree(path, ignore_errors=True)


def discard(target: Path) -> None:
    """Take an object that cannot be used out of the cache."""
    for path in (target, _beside(target)):
        with suppress(OSError):
            path.unlink()


def _fault(target: Path) -> str:
    """Return what is wrong with an object of the cache; "" for nothing."""
    try:
        for path in (target, _beside(target)):
            problem = problem_of(path)
            if problem:
                return problem
            if not stat.S_ISREG(path.lstat().st_mode):  # a pipe would be waited for
                return "it is no file"
        same = _beside(target).read_text(encoding="ascii", errors="replace") == _digest(target)
    except OSError as error:
        return str(error.strerror or error)
    return "" if same else "its content is not what was written"


def _beside(target: Path) -> Path:
    return target.with_suffix(".sha256")


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
