"""Writing files so that nothing is lost: either the whole new file is there, or the old one is."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from phcontrol.exceptions import DataFileError


def write_atomically(path: str | os.PathLike[str], write: Callable[[IO[bytes]], None]) -> Path:
    """Let ``write`` fill a temporary file beside ``path``, then move it into place.

    Folders are made as needed. Raises DataFileError, and leaves no partial file, when the disk is
    full or the place is not writable.
    """
    target = Path(path)
    temporary: str | None = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(descriptor, "wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
        temporary = None
    except OSError as error:
        raise DataFileError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
    return target


def write_json(path: str | os.PathLike[str], data: Any) -> Path:
    """Write ``data`` as indented JSON, atomically. Infinities and NaN are refused."""
    return write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text file in UTF-8, atomically."""
    return write_atomically(path, lambda file: _write_all(file, text.encode()))


def _write_all(file: IO[bytes], content: bytes) -> None:
    file.write(content)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
