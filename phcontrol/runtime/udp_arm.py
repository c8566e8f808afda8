"""An arm in another process, reached by UDP on this machine: a stand-in for a robot's control box.

A stand-in to try drivers and loops on, not a protocol for a robot: it answers nobody but the process that started it,
by a token that both know, but the token is readable to whoever can read this machine's memory or its packets.
"""

from __future__ import annotations

import hmac
import math
import multiprocessing
import os
import secrets
import select
import socket
import struct
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array, count, positive
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runtime.arm_driver import Pace, Reading, wait_until
from phcontrol.runtime.control_box import ControlBox
from phcontrol.runtime.control_loop import Gravity
from phcontrol.runtime.number_window import NumberWindow
from phcontrol.runtime.packet_faults import PacketFaults
from phcontrol.sensors.measured import Measured

_HOST = "127.0.0.1"
_HEAD = struct.Struct("<4sHHqd16s")  # magic, version, joints, number, time, token
_MAGIC, _VERSION = b"phct", 2
_TOKEN_SIZE = 16
_LARGEST = 4096
_MOST_AT_ONCE = 200  # packets looked at in a period, so that a flood cannot hold it up
_PATIENCE = 60.0  # for the other process to load its libraries [s]


class Packet(NamedTuple):
    """What one side says to the other."""

    number: int
    """Larger than those before."""
    time: float
    """When it was made, by this machine's clock (``time.perf_counter``), which both sides share [s]."""
    vectors: list[Array]
    """Of n numbers each."""


def pack(token: bytes, number: int, moment: float, *vectors: Array) -> bytes:
    """Return a packet: a head with number, time [s] and the session's token, then vectors of n doubles each."""
    joints = vectors[0].size
    return _HEAD.pack(_MAGIC, _VERSION, joints, number, moment, token) + b"".join(
        np.ascontiguousarray(vector, dtype="<f8").tobytes() for vector in vectors
    )


def unpack(token: bytes, packet: bytes, joints: int, vectors: int) -> Packet | None:
    """Return what a packet says; None for what is not of this session, of this size, and finite."""
    if len(packet) != _HEAD.size + 8 * joints * vectors:
        return None
    magic, version, of_joints, number, moment, of_token = _HEAD.unpack_from(packet)
    if magic != _MAGIC or version != _VERSION or of_joints != joints or number < 0:
        return None
    values = np.frombuffer(packet, dtype="<f8", offset=_HEAD.size).astype(np.float64)
    if not hmac.compare_digest(of_token, token) or not np.isfinite(values).all() or not math.isfinite(moment):
        return None
    return Packet(number, moment, list(values.reshape(vectors, joints)))


class UdpArm:
    """A driver for an arm in another process on this machine; a context manager that starts and ends it.

        with UdpArm(make_system, duration=10.0) as arm:
            drive(loop, arm, 8.0)

    The other process runs a :class:`ControlBox` in real time, sends a reading every period, and ends by itself after
    ``duration``, or in the period in which this process has ended, however it did. A stand-in for a robot, see the
    module: both sides talk on 127.0.0.1 only, use the newest packet alone (:class:`NumberWindow`), and refuse what is
    malformed or does not carry the session's random token.

    Args:
        make_system: makes the plant, in the other process: a function that can be pickled.
        duration: the other process's life [s].
        period: of readings [s].
        faults: arguments of :class:`PacketFaults`, for both ways.
        box: more arguments of :class:`ControlBox`.

    Example:
        >>> from phcontrol import InvalidArgumentError, MechanicalSystem, UdpArm, load_robot
        >>> try:
        ...     UdpArm(lambda: MechanicalSystem(load_robot("pera_shoulder")), duration=-1.0)
        ... except InvalidArgumentError as error:
        ...     print(error)  # examples/hardware_loop.py drives one
        duration: must be > 0, but is -1
    """

    pace: Pace = "clock"

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
        self.gravity: Gravity = (box or {}).get("gravity", "controller")
        PacketFaults(**(faults or {}))  # say now, not in the other process, what is wrong
        self._token = secrets.token_bytes(_TOKEN_SIZE)
        self._arguments = (make_system, self._duration, self._period, dict(faults or {}), dict(box or {}))
        self._socket: socket.socket | None = None
        self._process: Any = None
        self._number = 0
        self._peer: tuple[str, int] = (_HOST, 0)
        self._newest: Reading | None = None
        self._window, self._arrival, self._made = NumberWindow(), 0.0, 0.0
        self.counts = {"readings": 0, "old": 0, "malformed": 0}
        """Readings used, readings not in the window of numbers, and packets that were no readings of this session."""

    def __enter__(self) -> UdpArm:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((_HOST, 0))
        self._socket.setblocking(False)
        context = multiprocessing.get_context("spawn")
        address = self._socket.getsockname()
        arguments = (address, self._token, os.getpid(), *self._arguments)
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        self._arrival = start = time.perf_counter()
        while self.read() is None:
            left = _PATIENCE - (time.perf_counter() - start)
            if left <= 0.0 or not self._process.is_alive():
                self.__exit__(None, None, None)
                raise PHControlError(f"the arm's process did not answer within {_PATIENCE:g} s, or ended")
            select.select([self._socket], [], [], min(left, 1.0))
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
        """Return the newest reading; its age counts from when the other process made it."""
        assert self._socket is not None
        for _ in range(_MOST_AT_ONCE):
            try:
                packet, address = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except ConnectionError:  # the other process has gone; the reading grows older
                break
            content = unpack(self._token, packet, self._joints, 3)
            now = time.perf_counter()
            if content is None:
                self.counts["malformed"] += 1
            elif not self._window.accepts(content.number, (now - self._arrival) / self._period):
                self.counts["old"] += 1
            else:
                position, velocity, force = content.vectors
                self._newest, self._made = Reading(position, velocity, Measured(external_force=force)), content.time
                self._arrival = now
                self._peer = address
                self.counts["readings"] += 1
        if self._newest is None:
            return None
        return self._newest._replace(age=max(0.0, time.perf_counter() - self._made))

    def write(self, torque: Array) -> None:
        """Send a torque."""
        if self._newest is not None and self._socket is not None:
            try:
                self._socket.sendto(pack(self._token, self._number, time.perf_counter(), torque), self._peer)
            except OSError:  # the network is not there; the box has its own watchdog
                return
            finally:
                self._number += 1


def _serve(
    address: tuple[str, int],
    token: bytes,
    parent: int,
    make_system: Callable[[], MechanicalSystem],
    duration: float,
    period: float,
    faults: dict[str, Any],
    box_arguments: dict[str, Any],
) -> None:
    """Run a control box in real time until its duration is over, or the process that started it."""
    system = make_system()
    box = ControlBox(system, period=period, **box_arguments)
    seed = faults.pop("seed", 0)
    readings: PacketFaults[bytes] = PacketFaults(**faults, seed=seed)
    commands: PacketFaults[bytes] = PacketFaults(**faults, seed=seed + 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind((_HOST, 0))
        line.setblocking(False)
        k, due = 0, time.perf_counter()
        end = due + duration
        while due < end:
            wait_until(due)
            if os.getppid() != parent:  # nobody learns of it otherwise: to a socket that is gone one sends as well
                os._exit(0)  # at once: there is nothing to tidy up for, and that takes seconds on a busy machine
            for _ in range(_MOST_AT_ONCE):
                try:
                    commands.send(box.time, line.recv(_LARGEST))
                except OSError:  # nothing there
                    break
            for packet in commands.receive(box.time):
                content = unpack(token, packet, system.n, 1)
                if content is not None:
                    box.command(content.number, content.vectors[0])
            box.advance()
            now = box.reading()
            assert now.measured.external_force is not None
            readings.send(
                box.time,
                pack(token, k, time.perf_counter(), now.position, now.velocity, now.measured.external_force),
            )
            for packet in readings.receive(box.time):
                try:
                    line.sendto(packet, address)
                except OSError:
                    return
            # where this process had to wait, the arm's time waits too: in a burst it would jump
            k, due = k + 1, max(due + period, time.perf_counter())
