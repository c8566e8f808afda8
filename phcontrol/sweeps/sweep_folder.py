"""The folder of a sweep: whose it is, and which of its parts are there."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phcontrol._files import make_folder, open_regular, write_atomically, write_json
from phcontrol._version import __version__
from phcontrol.exceptions import DataFileError, InvalidArgumentError

MANIFEST, PARTS = "sweep.json", "parts"
"""What a folder holds."""
FORMAT = 1
_LARGEST = 1 << 24  # bytes of a manifest
_KEY = b"phcontrol.sweep"


def need_pyarrow() -> None:
    """Raise InvalidArgumentError where Parquet cannot be read and written."""
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise InvalidArgumentError("results", "need pyarrow: pip install 'phcontrol[sweeps]'") from error


class SweepFolder:
    """Makes the folder of a sweep, or finds that a folder is its.

    Args:
        folder: where.
        identity: what tells the sweep from others.
        record: the sweep, for JSON.
        columns: of the results, with their units.

    Raises:
        DataFileError: the folder holds another sweep, one of another version of phcontrol, or something else.
        InvalidArgumentError: pyarrow is not installed.
    """

    def __init__(self, folder: Path, identity: str, record: Mapping[str, Any], columns: Mapping[str, str]) -> None:
        need_pyarrow()
        self._folder, self._identity, self._columns = folder, identity, dict(columns)
        try:
            make_folder(folder)
            held = sorted(item for item in os.listdir(folder) if not item.endswith(".part"))  # of one that was killed
        except OSError as error:
            raise DataFileError(f"cannot write to {folder}: {error.strerror or error}") from error
        if MANIFEST in held:
            self._check(read_manifest(folder))
        elif held:
            raise DataFileError(f"{folder} holds {held[0]}, and is not of a sweep: give another folder")
        write_json(folder / MANIFEST, {"format": FORMAT, "hash": identity, "phcontrol": __version__,
                                       "columns": self._columns, "sweep": _finite(record)})  # fmt: skip
        make_folder(folder / PARTS)

    def _check(self, manifest: Mapping[str, Any]) -> None:
        if manifest["hash"] != self._identity:
            theirs = manifest.get("sweep", {})
            raise DataFileError(
                f"{self._folder} holds another sweep ({theirs.get('runs')} runs of {theirs.get('law', {}).get('name')} "
                f"on {theirs.get('arm', {}).get('robot')}, {manifest['hash'][:8]}; this one is {self._identity[:8]}): "
                "give another folder"
            )
        if manifest["phcontrol"] != __version__:
            raise DataFileError(
                f"{self._folder} was begun by phcontrol {manifest['phcontrol']}, and this is {__version__}: finish it "
                "with that one, or give another folder"
            )

    def has(self, first: int, last: int) -> bool:
        """Return whether a part is there, whole and of this sweep."""
        import pyarrow as arrow
        from pyarrow import parquet

        path = self._part(first)
        if not path.is_file() or path.is_symlink():
            return False
        try:
            found = parquet.read_metadata(path)
        except (arrow.ArrowException, OSError):
            return False
        key = (found.metadata or {}).get(_KEY)
        return bool(found.num_rows == last - first and key == self._mark(first))

    def write(self, first: int, columns: Mapping[str, Any]) -> int:
        """Write a part; return how many of its runs failed."""
        import pyarrow as arrow
        from pyarrow import parquet

        table = arrow.table({name: arrow.array(columns[name]) for name in self._columns})
        table = table.replace_schema_metadata({_KEY: self._mark(first)})
        write_atomically(self._part(first), lambda file: parquet.write_table(table, file))
        return int((columns["error"] != "").sum())

    def _part(self, first: int) -> Path:
        return self._folder / PARTS / f"runs-{first:010d}.parquet"

    def _mark(self, first: int) -> bytes:
        return f"{self._identity} {first}".encode()


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return what a sweep's folder says of itself. Raises DataFileError."""
    path = folder / MANIFEST
    if not path.is_file():
        raise DataFileError(f"{folder} is not of a sweep: it has no {MANIFEST}")
    with open_regular(path, follow_links=False) as file:
        content = file.read(_LARGEST)
    try:
        manifest = json.loads(content)
        whole = manifest["format"] == FORMAT and isinstance(manifest["hash"], str)
        whole = whole and isinstance(manifest["sweep"], dict) and isinstance(manifest["columns"], dict)
        whole = whole and isinstance(manifest["phcontrol"], str)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DataFileError(f"{path} is not that of a sweep: {error}") from error
    if not whole:
        raise DataFileError(f"{path} is not that of a sweep of this format ({FORMAT})")
    found: dict[str, Any] = manifest
    return found


def _finite(value: Any) -> Any:
    """Return a record with infinities as texts, which JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return repr(value) if isinstance(value, float) and not abs(value) < float("inf") else value
