"""The server of pages against pages from elsewhere, browsers that stand still, and parents that have gone."""

from __future__ import annotations

import base64
import contextlib
import http.client
import os
import select
import signal
import socket
import subprocess
import sys
from urllib.parse import urlsplit

import psutil
import pytest

from phcontrol import InvalidArgumentError, LiveView, PHControlError
from phcontrol.visualization.server import PageServer

PAGE = "<p>the page</p>"


@pytest.fixture
def served():
    with PageServer(0) as server:
        server.publish(PAGE)
        yield server


def ask(server, host, path="/", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", urlsplit(server.address).port)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in {"Host": host, **{key.replace("_", "-"): value for key, value in headers.items()}}.items():
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    text = "" if answer.status == 101 else answer.read().decode()
    answer.close()
    connection.close()
    return answer.status, text


UPGRADE = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13",
    "Sec_WebSocket_Key": base64.b64encode(bytes(16)).decode(),
}  # fmt: skip


def hosts(server):
    port = urlsplit(server.address).port
    ours = [f"127.0.0.1:{port}", f"localhost:{port}", f"LOCALHOST:{port}", "localhost:8000", "127.0.0.1"]
    return ours, [f"attacker.example:{port}", "attacker.example", f"127.0.0.1.attacker.example:{port}", "localhost.x",
                  f"127.0.0.1@attacker.example:{port}", "", "[", None]  # fmt: skip


def test_a_page_is_given_only_under_this_machines_names(served):
    ours, others = hosts(served)
    for host in ours:
        assert ask(served, host) == (200, PAGE)
    for host in others:
        status, text = ask(served, host)
        assert status in (400, 403), host
        assert PAGE not in text
    assert ask(served, ours[0], Origin="http://attacker.example")[0] == 403


def test_frames_are_given_only_to_the_page_of_this_server(served):
    ours, others = hosts(served)
    for host in ours:
        assert ask(served, host, "/frames", Origin=f"http://{host}", **UPGRADE)[0] == 101
    for host in others:  # the page of a rebound name has that name as its origin and as the host
        assert ask(served, host, "/frames", Origin=f"http://{host}", **UPGRADE)[0] in (400, 403), host
    for origin in ("http://attacker.example", "http://localhost:1", "null", "file://", None):
        assert ask(served, ours[0], "/frames", Origin=origin, **UPGRADE)[0] == 403, origin


class Reader:
    """A browser's socket, which reads when it is told to."""

    def __init__(self, server):
        parts = urlsplit(server.address)
        self.socket = socket.create_connection((parts.hostname, parts.port))
        headers = {"Host": parts.netloc, "Origin": f"http://{parts.netloc}"}
        headers |= {name.replace("_", "-"): value for name, value in UPGRADE.items()}
        lines = ["GET /frames HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
        self.socket.sendall("\r\n".join([*lines, "", ""]).encode())
        self.file = self.socket.makefile("rb")
        assert b"101" in self.file.readline()
        while self.file.readline().strip():
            pass

    def close(self):
        self.file.close()
        self.socket.close()

    def message(self):
        """Return a message's content, by the rules of RFC 6455, as the server may send it."""
        first, second = self.file.read(2)
        length = second & 127
        if length >= 126:
            length = int.from_bytes(self.file.read(2 if length == 126 else 8), "big")
        return first & 15, self.file.read(length)


def send_all(server, frames):
    for frame in frames:
        while not server.send(frame):
            select.select([], [server._socket], [], 1.0)


def test_frames_come_in_order_to_one_who_is_early_and_one_who_is_late(served):
    frames = [k.to_bytes(4, "little") * 300 for k in range(2000)]
    early = Reader(served)
    send_all(served, frames)
    served.end()
    for reader in (early, Reader(served)):
        received = b""
        while True:
            kind, content = reader.message()
            if kind == 1:
                assert content == b"end"
                break
            received += content
        assert received == b"".join(frames)
        reader.close()


def test_a_browser_that_stands_still_costs_no_memory(served):
    """Twenty that read nothing, and 100 MB of frames: what is kept is the history, once."""
    still = [Reader(served) for _ in range(20)]
    process = psutil.Process(served._process.pid)
    before = process.memory_info().rss
    send_all(served, (bytes([k % 256]) * 8192 for k in range(12_800)))
    served.end()
    late = Reader(served)  # gets the history, thinned; the server is through with all frames when it has
    kinds = []
    while 1 not in kinds:
        kinds.append(late.message()[0])
    assert process.memory_info().rss - before < 64e6
    for reader in (*still, late):
        reader.close()


def test_a_browser_that_stands_still_is_dropped(monkeypatch):
    """With little patience, in this process: the socket is closed, and another one goes on."""
    code = "import runpy, sys, tornado.websocket\n"
    code += "source = open(sys.argv.pop(1)).read().replace('PATIENCE = 10.0', 'PATIENCE = 0.3')\n"
    code += "exec(compile(source, 'serve', 'exec'))"
    popen = subprocess.Popen

    def impatient(command, **options):
        return popen([command[0], "-c", code, *command[1:]], **options)

    monkeypatch.setattr(subprocess, "Popen", impatient)
    with PageServer(0) as server:
        monkeypatch.undo()
        server.publish(PAGE)
        still = Reader(server)
        send_all(server, (bytes(8192) for _ in range(4000)))
        other = Reader(server)
        while other.message()[0] != 2:
            pass
        process = psutil.Process(server._process.pid)
        for _ in range(600):  # a minute at most
            if len(process.net_connections()) <= 2:  # it listens, and serves the other
                break
            other.socket.settimeout(0.1)
            with contextlib.suppress(TimeoutError):
                other.socket.recv(1 << 20)
        assert len(process.net_connections()) <= 2
        still.close()
        other.close()


PARENT = """
import os, sys, time
from phcontrol.visualization.server import PageServer
server = PageServer(0)
if sys.argv[1] == "published":
    server.publish("<p>page</p>")
if os.fork() == 0:  # holds the pipe to the server open, as a worker of a pool does
    print(os.getpid(), server._process.pid, flush=True)
    time.sleep(600)
time.sleep(600)
"""


@pytest.mark.parametrize("state", ["published", "waiting"])
def test_it_ends_with_its_parent(state):
    """Also when a child of the parent lives on with the pipe."""
    parent = subprocess.Popen([sys.executable, "-c", PARENT, state], stdout=subprocess.PIPE, text=True)
    with parent.stdout:
        child, server = map(int, parent.stdout.readline().split())
    process = psutil.Process(server)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    try:
        _, alive = psutil.wait_procs([process], timeout=60)
        assert alive == []
    finally:
        os.kill(child, signal.SIGKILL)
        if process.is_running():
            process.kill()


@pytest.mark.parametrize("port", [-1, 65536, 99999, 1 << 40, 7000.5, "7000", True])
def test_what_is_no_port_is_refused(port):
    for serve in (PageServer, lambda port: LiveView(port=port)):
        with pytest.raises(InvalidArgumentError, match="port: must be"):
            serve(port)


def test_a_server_that_has_ended_is_said():
    with PageServer(0) as server:
        server._process.kill()
        server._process.wait()
        with pytest.raises(PHControlError, match="has ended"):
            server.publish("x" * (1 << 20))
        assert server.send(b"frame") is False
