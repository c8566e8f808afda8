"""An arm in another process, reached by UDP on this machine: a stand-in for a robot's control box."""

from __future__ import annotations

import multiprocessing
import select
import socket
import struct
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any

import numpy as np

from phcontrol._validation import Array, count, positive
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.arm_driver import Reading, wait_until
from phcontrol.simulation.control_box import ControlBox
from phcontrol.simulation.packet_faults import PacketFaults

_HOST = "127.0.0.1"
_HEAD = struct.Struct("<4sHHq")  # magic, version, joints, number
_MAGIC, _VERSION = b"phct", 1
_LARGEST = 4096


def pack(number: int, *vectors: Array) -> bytes:
    """Return a packet: a head with a number, then vectors of n doubles each."""
    joints = vectors[0].size
    return _HEAD.pack(_MAGIC, _VERSION, joints, number) + b"".join(
        np.ascontiguousarray(vector, dtype="<f8").tobytes() for vector in vectors
    )


def unpack(packet: bytes, joints: int, vectors: int) -> tuple[int, list[Array]] | None:
    """Return number and vectors of a packet; None for anything that is not one of ours, of this size, and finite."""
    if len(packet) != _HEAD.size + 8 * joints * vectors:
        return None
    magic, version, of_joints, number = _HEAD.unpack_from(packet)
    values = np.frombuffer(packet, dtype="<f8", offset=_HEAD.size).astype(np.float64)
    if magic != _MAGIC or version != _VERSION or of_joints != joints or number < 0 or not np.isfinite(values).all():
        return None
    return number, list(values.reshape(vectors, joints))


class UdpArm:
    """A driver for an arm in another process on this machine; a context manager that starts and ends it.

        with UdpArm(make_system, duration=10.0) as arm:
            drive(loop, arm, 8.0)

    The other process runs a :class:`ControlBox` in real time, sends a reading every period, and ends by itself after
    ``duration``. Both sides talk on 127.0.0.1 only, use the newest packet alone, and refuse what is malformed.

    Args:
        make_system: makes the plant, in the other process: a function that can be pickled.
        duration: the other process's life [s].
        period: of readings [s].
        faults: arguments of :class:`PacketFaults`, for both ways.
        box: more arguments of :class:`ControlBox`.
    """

    def __init__(
        self,
        make_system: Callable[[], MechanicalSystem],
        *,
        duration: float,
        period: float = 1e-3,
        faults: Mapping[str, Any] | None = None,
        box: Mapping[str, Any] | None = None,
    ) -> None:
        self._duration, self._period = positive("duration", duration), positive("period", period)
        self._joints = count("joints", make_system().n)
        PacketFaults(**(faults or {}))  # say now, not in the other process, what is wrong
        self._arguments = (make_system, self._duration, self._period, dict(faults or {}), dict(box or {}))
        self._socket: socket.socket | None = None
        self._process: Any = None
        self._number = 0
        self._peer: tuple[str, int] = (_HOST, 0)
        self._newest: Reading | None = None
        self._newest_number, self._arrival = -1, 0.0
        self.counts = {"readings": 0, "old": 0, "malformed": 0}
        """Readings used, readings that were not newer, and packets that were not readings."""

    def __enter__(self) -> UdpArm:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((_HOST, 0))
        self._socket.setblocking(False)
        context = multiprocessing.get_context("spawn")
        address = self._socket.getsockname()
        self._process = context.Process(target=_serve, args=(address, *self._arguments), daemon=True)
        self._process.start()
        ready, _, _ = select.select([self._socket], [], [], 60.0)  # it loads its libraries first
        if not ready:
            self.__exit__(None, None, None)
            raise PHControlError("the arm's process did not answer within 60 s")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.join(5.0)
        if self._socket is not None:
            self._socket.close()

    def read(self) -> Reading | None:
        """Return the newest reading; its age counts from its arrival."""
        assert self._socket is not None
        while True:
            try:
                packet, address = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except ConnectionError:  # the other process has gone; the reading grows older
                break
            content = unpack(packet, self._joints, 3)
            if content is None:
                self.counts["malformed"] += 1
            elif content[0] <= self._newest_number:
                self.counts["old"] += 1
            else:
                self._newest_number, (position, velocity, force) = content
                self._newest = Reading(position, velocity, Measured(external_force=force))
                self._arrival = time.perf_counter()
                self._peer = address
                self.counts["readings"] += 1
        if self._newest is None:
            return None
        return self._newest._replace(age=time.perf_counter() - self._arrival)

    def write(self, torque: Array) -> None:
        """Send a torque."""
        if self._newest is not None and self._socket is not None:
            try:
                self._socket.sendto(pack(self._number, torque), self._peer)
            except OSError:  # the network is not there; the box has its own watchdog
                return
            finally:
                self._number += 1


def _serve(
    address: tuple[str, int],
    make_system: Callable[[], MechanicalSystem],
    duration: float,
    period: float,
    faults: dict[str, Any],
    box_arguments: dict[str, Any],
) -> None:
    """Run a control box in real time until its duration is over."""
    system = make_system()
    box = ControlBox(system, period=period, **box_arguments)
    seed = faults.pop("seed", 0)
    readings: PacketFaults[bytes] = PacketFaults(**faults, seed=seed)
    commands: PacketFaults[bytes] = PacketFaults(**faults, seed=seed + 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind((_HOST, 0))
        line.setblocking(False)
        start = time.perf_counter()
        for k in range(round(duration / period)):
            wait_until(start + k * period)
            while True:
                try:
                    commands.send(box.time, line.recv(_LARGEST))
                except BlockingIOError:
                    break
                except ConnectionError:
                    return  # nobody listens any more
            for packet in commands.receive(box.time):
                content = unpack(packet, system.n, 1)
                if content is not None:
                    box.command(content[0], content[1][0])
            box.advance()
            now = box.reading()
            assert now.measured.external_force is not None
            readings.send(box.time, pack(k, now.position, now.velocity, now.measured.external_force))
            for packet in readings.receive(box.time):
                try:
                    line.sendto(packet, address)
                except OSError:
                    return
