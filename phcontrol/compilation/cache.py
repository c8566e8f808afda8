"""Compiled objects by their content, in a folder that is the user's own."""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from phcontrol.compilation.compiler import Compiler
from phcontrol.compilation.errors import CompilationError, CompilationWarning


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
    above = folder.parent.resolve()
    for parent in (above, *above.parents):
        status = parent.stat()
        if status.st_mode & stat.S_IWOTH and not status.st_mode & stat.S_ISVTX:
            raise CompilationError(f"the cache {folder} is refused: everybody may write to {parent}")
    return folder


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

    Raises:
        CompilationError: the folder is not the user's own, the disk is full, the compiler fails, or what it made is
            not accepted.
    """
    folder = open_folder(cache_folder())
    key = hashlib.sha256(f"{compiler.identity(native)}\n{source}".encode()).hexdigest()
    target = folder / f"{key}.so"
    if target.exists() or target.is_symlink():
        problem = _fault(target)
        if not problem:
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
    except OSError as error:
        raise CompilationError(f"the cache {folder} cannot be written to: {error.strerror or error}") from error
    return target


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
