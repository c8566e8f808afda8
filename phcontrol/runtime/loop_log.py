"""The log of a control loop: a ring of rows in a file that outlives the process."""

from __future__ import annotations

import hashlib
import json
import mmap
import os
import struct
import time
from types import TracebackType
from typing import Any

import numpy as np

from phcontrol._files import check_file_place, open_regular
from phcontrol._validation import Array, file_path, instance, positive
from phcontrol._version import __version__
from phcontrol.exceptions import DataFileError, PHControlError
from phcontrol.runtime.arm_driver import Reading
from phcontrol.runtime.control_loop import ControlLoop
from phcontrol.runtime.loop_mode import LoopMode
from phcontrol.simulation.signals import Exported, Signal, Signals

_MAGIC = b"phcloop2"
_HEAD = struct.Struct("<8sQQQ32s")  # magic, bytes of the text that follows, numbers in a row, rows, SHA-256 of these
_PAGE = 4096
_LARGEST_TEXT = 2**20
_LARGEST = 2**36  # of a file [bytes]
_UNITS = {
    "position": "rad", "velocity": "rad/s", "torque": "N·m", "desired": "N·m", "external_force": "N·m",
    "age": "s", "computing": "s", "mode": "1", "filter": "1", "state": "1",
}  # fmt: skip


class LoopLog:
    """Keeps the newest rows of a loop in a file: what it read, what the law desired, what was sent, and how it went.

        with LoopLog("run.loop", loop, duration=600.0) as log:
            drive(loop, arm, 60.0, each_step=log)
        record = read_loop_log("run.loop")
        record.to_mcap("run.mcap")

    The file is as large as ``duration`` asks from the start, and mapped into memory: a row is written by copying some
    300 bytes, which never waits for the disk; the operating system writes it in the background. So **nothing is lost
    when the process ends**, by an error, a signal or ``kill -9`` (only when the computer does): each row carries its
    number, written last, and a row that was cut off is left out when read. When the file is full the oldest rows are
    written over.

    Args:
        path: of the file; an old one is replaced, but for one that another LoopLog is writing.
        loop: whose steps they are.
        duration: how much is kept [s].

    Raises:
        InvalidArgumentError: what is given is no loop, or no duration.
        PHControlError: another LoopLog writes this file, or there is no room for it.

    Example:
        >>> import tempfile
        >>> from phcontrol import ControlBox, ControlLoop, EnergyShaping, LoopLog, MechanicalSystem
        >>> from phcontrol import SimulatedArm, drive, load_robot, read_loop_log
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> box = ControlBox(system)
        >>> loop = ControlLoop(system, EnergyShaping.tuned(system), 1e-3, clock=lambda: box.time, deadline=1.0)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     with LoopLog(folder + "/run.loop", loop, duration=1.0) as log:
        ...         drive(loop, SimulatedArm(box), 0.2, each_step=log)
        ...     kept = read_loop_log(folder + "/run.loop")
        >>> kept.column("torque").shape
        (200, 2)
    """

    def __init__(self, path: str | os.PathLike[str], loop: ControlLoop, duration: float = 600.0) -> None:
        self.path, self._loop = file_path("path", path), instance("loop", loop, ControlLoop)
        n, states = loop.system.n, loop.controller_state.size
        self._sizes = {
            "time": 1, "age": 1, "computing": 1, "mode": 1, "filter": 1,
            "position": n, "velocity": n, "torque": n, "desired": n, "external_force": n, "state": states,
        }  # fmt: skip
        self._places: dict[str, slice] = {}
        place = 1
        for name, size in self._sizes.items():
            self._places[name] = slice(place, place + size)
            place += size
        self._rows = max(2, round(min(positive("duration", duration) / loop.period, 2.0**40)))
        about = {
            "phcontrol": __version__, "robot": loop.system.robot.name, "joints": list(loop.system.robot.joint_names),
            "law": loop.law_name, "period": loop.period, "gravity": loop.gravity, "began": time.time(),
            "places": {name: [part.start, part.stop] for name, part in self._places.items()},
        }  # fmt: skip
        text = json.dumps(about).encode()
        start = -(-(_HEAD.size + len(text)) // _PAGE) * _PAGE
        size = start + 8 * place * self._rows
        self._file = os.fdopen(self._make(size), "r+b")  # open, and so locked, as long as this log is
        self._map = mmap.mmap(self._file.fileno(), size)
        self._map[: _HEAD.size + len(text)] = _head(text, place, self._rows) + text
        self._table: Array = np.frombuffer(self._map, dtype=np.float64, count=place * self._rows, offset=start)
        self._table = self._table.reshape(self._rows, place)
        self._table[:] = 0.0  # so that no page is touched for the first time within a period
        self._row = np.zeros(place)
        self._count = 0

    def __enter__(self) -> LoopLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __len__(self) -> int:
        """How many rows are kept."""
        return min(self._count, self._rows)

    def __call__(self, t: float, reading: Reading, torque: Array) -> None:
        """Keep a row: an ``each_step`` of ``drive``. Raises PHControlError once the log is closed."""
        if self._map.closed:
            raise PHControlError(f"{self.path}: this log is closed; what was written is there to be read")
        row, places, loop = self._row, self._places, self._loop
        row[places["time"]], row[places["age"]] = t, reading.age
        row[places["computing"]], row[places["mode"]] = loop.computing, loop.mode
        filtered = loop.filtered
        row[places["filter"]] = np.nan if filtered is None else filtered.status
        row[places["position"]], row[places["velocity"]] = reading.position, reading.velocity
        row[places["torque"]], row[places["desired"]] = torque, loop.desired_torque
        force = reading.measured.external_force
        row[places["external_force"]] = np.nan if force is None else force
        row[places["state"]] = loop.controller_state
        kept = self._table[self._count % self._rows]
        kept[0] = 0.0
        kept[1:] = row[1:]
        self._count += 1
        kept[0] = self._count  # last: a row without its number is none

    def close(self) -> None:
        """Write what the operating system has not written yet, and let go of the file."""
        if not self._map.closed:
            del self._table
            self._map.flush()
            self._map.close()
            _unlock(self._file.fileno())  # a forked process may have the same file open
            self._file.close()

    def _make(self, size: int) -> int:
        """Return a new file of a size, whose place on the disk is taken: a full disk must not be met in a loop.

        It is locked for as long as it is open, which the operating system ends with the process.
        """
        check_file_place(self.path)
        self._check_unused()
        if size > _LARGEST:
            raise PHControlError(f"{self.path}: a log of {size / 2**30:.0f} GB is too large; keep a shorter duration")
        fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        file = os.open(fresh, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644)
        try:
            os.posix_fallocate(file, 0, size)
            _lock(file)
            os.replace(fresh, self.path)
        except OSError as error:
            os.close(file)
            fresh.unlink(missing_ok=True)
            raise PHControlError(
                f"{self.path}: no place for a log of {size / 2**20:.0f} MB: {error.strerror}"
            ) from error
        return file

    def _check_unused(self) -> None:
        """Raise PHControlError while another LoopLog writes the file: it would go on into one without a name."""
        try:
            old = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError:
            return  # there is none, or none that can be read: it is replaced
        try:
            _lock(old)
        except BlockingIOError as error:
            raise PHControlError(
                f"{self.path}: another LoopLog is writing this file; give each loop its own"
            ) from error
        finally:
            os.close(old)


def _lock(file: int) -> None:
    """Lock a file for this process. Raises BlockingIOError where it is locked."""
    import fcntl

    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _unlock(file: int) -> None:
    import fcntl

    fcntl.flock(file, fcntl.LOCK_UN)


def _head(text: bytes, width: int, rows: int) -> bytes:
    """Return the beginning of a file: it tells where numbers are, and whether it is as it was written."""
    plain = _HEAD.pack(_MAGIC, len(text), width, rows, bytes(32))
    return plain[:-32] + hashlib.sha256(plain + text).digest()


class LoopRecord(Exported):
    """What a :class:`LoopLog` kept, oldest row first.

    Example:
        >>> import numpy as np
        >>> from phcontrol import LoopRecord
        >>> about = {"robot": "arm", "joints": ["elbow"], "places": {"time": [1, 2], "torque": [2, 3]}}
        >>> kept = LoopRecord(about, np.array([[1.0, 0.0, 0.2], [2.0, 1e-3, 0.3]]))
        >>> kept.time, kept.column("torque")[:, 0]
        (array([0.   , 0.001]), array([0.2, 0.3]))
    """

    def __init__(self, about: dict[str, Any], table: Array) -> None:
        self.about = about
        """Robot, joints, law, period, when it began [s since 1970]."""
        self._table, self._places = table, about["places"]

    def __len__(self) -> int:
        return len(self._table)

    def __repr__(self) -> str:
        return f"<LoopRecord of {self.about['robot']}: {len(self)} steps>"

    def column(self, name: str) -> Array:
        """Return a quantity of every row: "time", "position", "velocity", "torque" (sent), "desired" (by the law),
        "external_force" (NaN where none was measured), "state", "mode", "filter", "age" or "computing".

        Raises PHControlError for another name.
        """  # noqa: D205
        if name not in self._places:
            raise PHControlError(f"a loop's log has no '{name}'; it has {', '.join(self._places)}")
        first, last = self._places[name]
        values: Array = self._table[:, first:last]
        several = ("position", "velocity", "torque", "desired", "external_force", "state")
        return values if name in several else values[:, 0]

    @property
    def time(self) -> Array:
        """Of each step [s]."""
        return self.column("time")

    @property
    def modes(self) -> list[LoopMode]:
        """Of each step."""
        return [LoopMode(int(mode)) for mode in self.column("mode")]

    @property
    def signals(self) -> Signals:
        """All quantities, for other programs."""
        joints = tuple(self.about["joints"])
        quantities = {}
        for name in self._places:
            values = self.column(name)
            if name == "time" or not values.size:
                continue
            labels = joints if values.ndim == 2 and name != "state" else ()
            quantities[name] = Signal(values, _UNITS[name], labels)
        about = {name: value for name, value in self.about.items() if name != "places"}
        return Signals(self.time, quantities, about)


def read_loop_log(path: str | os.PathLike[str]) -> LoopRecord:
    """Return what a loop's log has kept, while it is written or after, however the loop's process ended.

    Raises DataFileError where the file is none, is cut off, or is not as it was written.

    Example:
        >>> from phcontrol import DataFileError, read_loop_log
        >>> try:
        ...     read_loop_log("no_such.loop")
        ... except DataFileError as error:
        ...     print("refused:", "no_such.loop" in str(error))
        refused: True
    """
    file_path("path", path)
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size or not head.startswith(_MAGIC):
                raise DataFileError(f"{os.fspath(path)}: not the log of a control loop")
            _, length, width, rows, _ = _HEAD.unpack(head)
            if length > _LARGEST_TEXT or not 0 < width < 2**16 or not 0 < rows < 2**40:
                raise DataFileError(f"{os.fspath(path)}: its head makes no sense")
            text = file.read(length)
            if _head(text, width, rows) != head:
                raise DataFileError(f"{os.fspath(path)}: its head was changed after it was written")
            about = json.loads(text)
            start = -(-(_HEAD.size + length) // _PAGE) * _PAGE
            if size != start + 8 * width * rows or size > _LARGEST:
                raise DataFileError(f"{os.fspath(path)}: cut off: {size} bytes in place of {start + 8 * width * rows}")
            file.seek(start)
            table = np.frombuffer(file.read(8 * width * rows), dtype=np.float64).reshape(rows, width)
        _check(about, width)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DataFileError(f"{os.fspath(path)}: not the log of a control loop: {error}") from error
    numbers = table[:, 0]
    whole = (numbers > 0.0) & (numbers % rows == (np.arange(rows) + 1) % rows)
    record = LoopRecord(about, table[whole][np.argsort(numbers[whole])])
    if not (np.isfinite(record.time).all() and np.isin(record.column("mode"), [int(mode) for mode in LoopMode]).all()):
        raise DataFileError(f"{os.fspath(path)}: a row has no time, or a mode that no loop has: it was changed")
    return record


def _check(about: Any, width: int) -> None:
    """Raise ValueError unless a log's text says where its numbers are: one quantity after another, each of its size."""
    joints, places = about["joints"], about["places"]
    texts = [about["robot"], about["law"], *joints]
    if not isinstance(joints, list) or not joints or not all(isinstance(item, str) for item in texts):
        raise ValueError("robot, law and joints must be names")
    if places.keys() != _UNITS.keys() | {"time"}:
        raise ValueError("it does not have the quantities of a loop")
    vectors = ("position", "velocity", "torque", "desired", "external_force")
    end = 1
    for first, last in sorted(places.values()):
        if first != end or last < first:
            raise ValueError("its quantities are not where they can be")
        end = last
    sizes = {name: last - first for name, (first, last) in places.items() if name != "state"}
    if end != width or any(size != (len(joints) if name in vectors else 1) for name, size in sizes.items()):
        raise ValueError("its quantities are not where they can be")
