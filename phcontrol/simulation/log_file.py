"""The file of a log: what is in it, how it is written, and what is refused when it is read.

An ``.npz`` archive: one array of float64 each for what was recorded and what follows from it, the metadata as JSON,
and a SHA-256 over both. A file may come from anyone: sizes are bounded before anything is unpacked, only plain
numbers are read, and everything is checked before it is believed.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from phcontrol._files import open_regular, write_atomically
from phcontrol._validation import Array
from phcontrol.exceptions import DataFileError
from phcontrol.simulation.derived import DERIVED, JOINTS, OPTIONAL

FORMAT = "phcontrol-log-2"
LARGEST = 1 << 30
"""Bytes that a file may unpack to: some 25 minutes of seven joints at 1 kHz."""
LARGEST_METADATA = 1 << 24
"""Bytes of the metadata, most of which are the robot's URDF."""
MOST_MEMBERS = 100

RECORDED = ("time", "position", "velocity", "torque", "external_force", "controller_state", "body_state")
MEASURED, FILTER = "measured_", "filter_"
FEATURES = 3
_NEEDED = (*RECORDED, *(name for name in DERIVED if name not in OPTIONAL))
_FINITE = ("time", "position", "velocity", "goal")
"""A run stops where these are not finite; NaN elsewhere says that something was not seen, or overflowed."""
_COUNTED = {"contact_forces": "bodies", "contact_depths": "bodies", "wrench_forces": "wrench_frames"}
"""Which entry of the metadata says how many there are of each."""
_METADATA, _HASH = "metadata", "sha256"


def write_log(
    path: str | os.PathLike[str], arrays: Mapping[str, Array], metadata: Mapping[str, Any], compress: bool = True
) -> Path:
    """Write arrays and metadata with their hash, atomically. Raises DataFileError."""
    text = json.dumps(dict(metadata) | {"format": FORMAT}).encode()
    content = {name: np.ascontiguousarray(array, dtype="<f8") for name, array in arrays.items()}
    content[_HASH] = np.frombuffer(_hash(content, text), dtype=np.uint8)
    content[_METADATA] = np.frombuffer(text, dtype=np.uint8)
    save = np.savez_compressed if compress else np.savez
    return write_atomically(path, lambda file: save(file, **content))  # type: ignore[arg-type]


def read_log(path: str | os.PathLike[str], largest: int = LARGEST) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays, read-only, and the metadata of a log's file that unpacks to at most ``largest`` bytes.

    Raises DataFileError, naming what is wrong.
    """
    with open_regular(path) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                return _read(archive, largest)
        except _Problem as problem:
            raise DataFileError(f"cannot read {path} as a log: {problem}") from None
        except Exception as error:  # damaged archives raise a dozen kinds
            raise DataFileError(f"cannot read {path} as a log: {error or type(error).__name__}") from error


class _Problem(Exception):  # noqa: N818 - carries what is said of the file
    """What is wrong with a file."""


def _read(archive: zipfile.ZipFile, largest: int) -> tuple[dict[str, Array], dict[str, Any]]:
    members = _members(archive, largest)
    for name in (_METADATA, _HASH):
        if name not in members:
            raise _Problem(f"it has no {name}" if name == _METADATA else "it has no content hash")
    text = _bytes(archive, members.pop(_METADATA), LARGEST_METADATA)
    metadata = _parse(text)
    expected = _bytes(archive, members.pop(_HASH), 32)
    missing = [name for name in _NEEDED if name not in members]
    if missing:
        raise _Problem(f"it is incomplete (missing {missing})")
    samples, joints = 0, len(metadata["joint_names"])
    data: dict[str, Array] = {}
    for name in sorted(members, key=lambda name: name != "time"):  # time first: it says how many samples there are
        with archive.open(members[name]) as stream:
            shape = _header(stream, members[name], name, np.dtype("<f8"))
            samples = shape[0] if name == "time" and shape else samples
            _check_shape(name, shape, samples, joints)
            data[name] = _numbers(stream, shape)
    _check_samples(data)
    _check_counts(data, metadata)
    if _hash(data, text) != expected:
        raise _Problem("its content is not what its hash says: it was changed after it was written")
    return data, metadata


# --- the archive ------------------------------------------------------------------------------------


def _members(archive: zipfile.ZipFile, largest: int) -> dict[str, zipfile.ZipInfo]:
    """Return the members by name, of an archive that says it is small enough and plain."""
    entries = archive.infolist()
    members = {entry.filename.removesuffix(".npy"): entry for entry in entries}
    if len(entries) > MOST_MEMBERS or len(members) < len(entries):
        raise _Problem("its members are too many, or have the same names")
    for entry in entries:
        # the other methods unpack without a bound on what one read gives
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or entry.flag_bits & 1:
            raise _Problem(f"{entry.filename!r} is encrypted, or packed by another method than deflate")
    size = sum(entry.file_size for entry in entries)
    if size > largest:
        raise _Problem(
            f"it unpacks to {size / 1e6:.0f} MB, more than {largest / 1e6:.0f} MB: read a log of your own that is so "
            "long with Log.load(path, largest=...)"
        )
    return members


def _header(stream: IO[bytes], entry: zipfile.ZipInfo, name: str, dtype: np.dtype[Any]) -> tuple[int, ...]:
    """Read an array's header; return the shape of one that holds a dtype, in C order, and nothing else."""
    try:
        version = npy.read_magic(stream)
        shape, fortran, found = npy.read_array_header_1_0(stream)
    except Exception as error:  # NumPy's own messages advise to trust the file
        raise _Problem(f"{name} has no valid header") from error
    if found != dtype:
        raise _Problem(f"{name} holds {found}, not {dtype}")
    size = math.prod(shape) * dtype.itemsize
    if version != (1, 0) or (fortran and len(shape) > 1) or min(shape, default=0) < 0:
        raise _Problem(f"{name} has no valid header")
    if stream.tell() + size != entry.file_size:
        raise _Problem(f"{name} has {entry.file_size - stream.tell()} bytes, not the {size} of its shape {shape}")
    return shape


def _numbers(stream: IO[bytes], shape: tuple[int, ...]) -> Array:
    array = np.empty(shape, dtype="<f8")
    _fill(stream, array.reshape(-1).view(np.uint8).data)
    array.flags.writeable = False
    return array


def _bytes(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, most: int) -> bytes:
    """Return a member that holds bytes."""
    name = entry.filename.removesuffix(".npy")
    with archive.open(entry) as stream:
        size = math.prod(_header(stream, entry, name, np.dtype(np.uint8)))
        if size > most:
            raise _Problem(f"{name} has {size} bytes, more than {most}")
        content = bytearray(size)
        _fill(stream, memoryview(content))
    return bytes(content)


def _fill(stream: IO[bytes], view: memoryview) -> None:
    """Read as many bytes as there is room for, in pieces; there must be so many, and no more."""
    piece, done = 1 << 20, 0
    while done < len(view):
        part = stream.read(min(piece, len(view) - done))
        if not part:
            raise _Problem("it ends before all of its numbers")
        view[done : done + len(part)] = part
        done += len(part)
    if stream.read(1):
        raise _Problem("it holds more than it says")


def _hash(data: Mapping[str, Array], metadata: bytes) -> bytes:
    """Return SHA-256 of names, shapes and numbers, and of the metadata as it stands in the file."""
    digest = hashlib.sha256()
    for name in sorted(data):
        digest.update(f"{name} {data[name].shape}\n".encode())
        digest.update(data[name].reshape(-1).view(np.uint8).data)
    digest.update(b"metadata\n" + metadata)
    return digest.digest()


# --- what is in it ----------------------------------------------------------------------------------


def _check_shape(name: str, shape: tuple[int, ...], samples: int, joints: int) -> None:
    per_sample: tuple[int | None, ...]
    if name in DERIVED:
        per_sample = tuple(joints if size == JOINTS else size for size in DERIVED[name].shape)
    elif name == "time" or (name.startswith(FILTER) and not name.endswith("torque")):
        per_sample = ()
    elif name in ("controller_state", "body_state"):
        per_sample = (None,)
    elif name in ("features", f"{MEASURED}features"):
        per_sample = (FEATURES,)
    elif name in RECORDED or name.startswith((MEASURED, FILTER)):
        per_sample = (joints,)
    else:
        raise _Problem(f"{name!r} is nothing that a log holds")
    expected = (samples, *per_sample)
    if len(shape) != len(expected) or any(
        want is not None and size != want for size, want in zip(shape, expected, strict=True)
    ):
        free = tuple("any" if want is None else want for want in expected)
        raise _Problem(f"{name} has shape {shape}, not {free}")


def _check_samples(data: Mapping[str, Array]) -> None:
    time = data["time"]
    if time.size == 0:
        raise _Problem("it holds no sample")
    for name in filter(data.__contains__, _FINITE):
        rows = np.flatnonzero(~np.isfinite(data[name]).reshape(len(time), -1).all(axis=1))
        if rows.size:
            raise _Problem(f"{name} is not finite at sample {rows[0]}")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        k = back[0]
        raise _Problem(f"its time runs back from {time[k]:g} s to {time[k + 1]:g} s at sample {k + 1}")


def _check_counts(data: Mapping[str, Array], metadata: Mapping[str, Any]) -> None:
    for name, key in _COUNTED.items():
        size = DERIVED[name].shape[-1] or 1
        described, held = len(metadata.get(key, ())), data[name][0].size // size if name in data else 0
        if described != held:
            raise _Problem(f"'{key}' of its metadata has {described} entries, but {name} is of {held}")


def _parse(text: bytes) -> dict[str, Any]:
    try:
        metadata = json.loads(text.decode())
    except (ValueError, RecursionError) as error:
        raise _Problem(f"its metadata are no JSON ({error})") from error
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
        known = metadata.get("format") if isinstance(metadata, dict) else None
        raise _Problem(
            "its format phcontrol-log-1 has no content hash: repeat the run with this version"
            if known == "phcontrol-log-1"
            else f"it is not of format {FORMAT}"
        )
    for problem in _metadata_problems(metadata):
        raise _Problem(problem)
    return metadata


def _metadata_problems(metadata: dict[str, Any]) -> Iterator[str]:
    for key, (needed, fits, right) in _ENTRIES.items():
        if key not in metadata and needed:
            yield f"its metadata have no '{key}'"
        elif key in metadata and not fits(metadata[key]):
            yield f"'{key}' of its metadata must be {right}"
    names = metadata["joint_names"]
    if not names or len(set(names)) < len(names):
        yield "'joint_names' of its metadata must be different names, at least one"
    limit = metadata.get("torque_limit")
    if limit is not None and len(limit) != len(names):
        yield "'torque_limit' of its metadata must be a number > 0 for each joint"


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_positive(value: Any) -> bool:
    return type(value) in (int, float) and 0.0 < value < math.inf


def _is_whole(value: Any) -> bool:
    return type(value) is int


def _is_table(value: Any) -> bool:
    return isinstance(value, dict)


def _or_none(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: value is None or fits(value)


def _list_of(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(map(fits, value))


def _table_of(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, dict) and all(map(fits, value.values()))


_ENTRIES: dict[str, tuple[bool, Callable[[Any], bool], str]] = {
    "robot": (True, _is_text, "text"),
    "controller": (True, _is_text, "text"),
    "joint_names": (True, _list_of(_is_text), "a list of names"),
    "interconnection": (False, _is_text, "text"),
    "integrator": (False, _is_text, "text"),
    "robot_record": (False, _is_table, "a table"),
    "plant": (False, _is_table, "a table"),
    "bodies": (False, _list_of(_is_table), "a list of tables"),
    "sight": (False, _or_none(_is_table), "a table or null"),
    "wrench_frames": (False, _list_of(_is_text), "a list of names"),
    "seeds": (False, _table_of(_or_none(_is_whole)), "a table of whole numbers"),
    "dt": (False, _is_positive, "a number > 0"),
    "control_period": (False, _or_none(_is_positive), "a number > 0 or null"),
    "torque_delay": (False, lambda value: value == 0.0 or _is_positive(value), "a number >= 0"),
    "torque_limit": (False, _or_none(_list_of(_is_positive)), "a list of numbers > 0"),
    "versions": (False, _table_of(_is_text), "a table of text"),
}
"""Entries of the metadata: whether each must be there, what fits, and how that is said."""
