"""Serving a page to a browser on this machine."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import subprocess
import sys
import webbrowser
from pathlib import Path

from phcontrol._validation import count
from phcontrol.exceptions import InvalidArgumentError, PHControlError

FIRST_PORT, PORTS = 7000, 20
LAST_PORT = 65535
_MESSAGES, _LONGEST = 100, 4096


def check_port(port: int) -> int:
    """Return a port to serve on, 0 for any free one. Raises InvalidArgumentError."""
    if count("port", port, minimum=0) > LAST_PORT:
        raise InvalidArgumentError("port", f"must be from 0 to {LAST_PORT}, but is {port}")
    return int(port)


class PageServer:
    """A page at ``address``, served by a process of its own from ``publish`` until ``close``.

    Args:
        port: to listen on; 0 for any free one; by default the first free one from 7000.

    Only this machine can open it, and only under its own names: a page from elsewhere cannot read it.

    Raises InvalidArgumentError for what is no port, and PHControlError when it is taken.
    """

    def __init__(self, port: int | None = None) -> None:
        ports = range(FIRST_PORT, FIRST_PORT + PORTS) if port is None else [check_port(port)]
        for candidate in ports:
            problem = self._start(candidate)
            if not problem:
                return
        if port is None:
            raise PHControlError(f"no free port from {FIRST_PORT} to {FIRST_PORT + PORTS - 1} ({problem})")
        raise PHControlError(f"port {port} cannot be used ({problem}): give another, or 0 for any free one")

    def _start(self, port: int) -> str:
        """Start the process; return what went wrong, or nothing."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._process = subprocess.Popen(
            [
                sys.executable,
                str(Path(__file__).with_name("_serve.py")),
                str(port),
                str(theirs.fileno()),
                str(os.getpid()),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(theirs.fileno(),),
            start_new_session=True,  # the keyboard's interrupt is for the run's own process, which then ends this one
        )
        theirs.close()
        ours.setblocking(False)
        self._socket = ours
        assert self._process.stdout is not None
        answer = self._process.stdout.readline()
        if not answer:
            self.close()
            return "the server ended"
        reply = json.loads(answer)
        if "error" in reply:
            self.close()
            return str(reply["error"])
        self.address = f"http://127.0.0.1:{reply['port']}/"
        return ""

    def publish(self, page: str) -> None:
        """Serve a page from now on. Once."""
        content = page.encode()
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(len(content).to_bytes(8, "big") + content)
            self._process.stdin.flush()
        except BrokenPipeError as error:
            raise PHControlError("the process that serves the page has ended") from error

    def send(self, frame: bytes) -> bool:
        """Hand a frame to the browsers; return False if it was dropped because they are behind. Never waits."""
        try:
            self._socket.send(frame)
        except (BlockingIOError, OSError):
            return False
        return True

    def received(self) -> list[bytes]:
        """Return what browsers have asked for since the last call, at most a hundred messages. Never waits."""
        found: list[bytes] = []
        with contextlib.suppress(BlockingIOError, OSError):
            while len(found) < _MESSAGES:
                found.append(self._socket.recv(_LONGEST))
        return found

    def end(self) -> None:
        """Say that no more frames will come."""
        self._socket.setblocking(True)
        self._socket.settimeout(1.0)
        with contextlib.suppress(OSError):
            self._socket.send(b"")

    def wait_for_browser(self, timeout: float) -> bool:
        """Wait until a browser has opened a live page, at most ``timeout`` [s]."""
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], timeout)
        return bool(ready) and self._process.stdout.readline().startswith(b"connected")

    def wait(self, message: str) -> None:
        """Print a message and serve until interrupted from the keyboard, which may be as soon as it is read."""
        with contextlib.suppress(KeyboardInterrupt):
            print(message, flush=True)
            self._process.wait()

    def close(self) -> None:
        """Stop serving."""
        self._socket.close()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()
        try:
            self._process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> PageServer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def open_browser(address: str) -> bool:
    """Open a page in the user's browser; return False where there is none to open it in."""
    graphical = sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or os.environ.get("BROWSER")
    )
    if not graphical:
        return False  # a text browser would take over the terminal, and can show nothing
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False


def announce_page(server: PageServer) -> None:
    """Open a served page in a browser and say so; where there is none, print its address and what to do with it."""
    if open_browser(server.address):
        print(f"watching at {server.address}", flush=True)
        server.wait_for_browser(5.0)
    else:
        print(
            f"watching at {server.address}: open it in a browser (none can be opened from here; from another machine "
            f"use ssh -L, or write a page with --record FILE.html)",
            flush=True,
        )


def view(page: str, *, port: int | None = None) -> None:
    """Serve a page until interrupted from the keyboard."""
    with PageServer(port) as server:
        server.publish(page)
        announce_page(server)
        server.wait("press Ctrl-C to stop")
