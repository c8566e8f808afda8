"""The process that serves a page and forwards frames to it. Run as a file: it needs Tornado, nothing of phcontrol.

Standard output: one JSON line, the port or an error; and one line more when a browser connects for the first time.
Standard input: the page's length (8 bytes, big-endian) and the page; when it ends, the server does. Frames come as
datagrams on the socket whose number is given, an empty one at the end of the run. A process of its own keeps all
this out of the control loop.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import sys

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

HISTORY = 20000
"""Frames kept for a browser that comes late; when there are more, every other one is dropped."""


class State:
    """What has come so far, and who watches."""

    def __init__(self, page: bytes) -> None:
        self.page, self.frames, self.ended, self.greeted = page, list[bytes](), False, False
        self.browsers: set[Frames] = set()


class Page(tornado.web.RequestHandler):
    """The page."""

    def initialize(self, state: State) -> None:
        """Keep what has come."""
        self.state = state

    def get(self) -> None:
        """Send it."""
        self.set_header("Cache-Control", "no-store")
        self.write(self.state.page)


class Frames(tornado.websocket.WebSocketHandler):
    """A browser that watches."""

    def initialize(self, state: State) -> None:
        """Keep what has come."""
        self.state = state

    def open(self, *args: str, **kwargs: str) -> None:
        """Send what has come so far; more follows."""
        self.set_nodelay(True)
        if self.state.frames:
            self.write_message(b"".join(self.state.frames), binary=True)
        if self.state.ended:
            self.write_message("end")
        self.state.browsers.add(self)
        if not self.state.greeted:
            self.state.greeted = True
            print("connected", flush=True)

    def on_close(self) -> None:
        """Forget it."""
        self.state.browsers.discard(self)


def forward(source: socket.socket, state: State) -> None:
    """Take the frames that are there and send them on."""
    while True:
        try:
            frame = source.recv(1 << 20)
        except BlockingIOError:
            return
        if not frame:
            state.ended = True
            for browser in state.browsers:
                browser.write_message("end")
            return
        state.frames.append(frame)
        if len(state.frames) > HISTORY:
            del state.frames[1::2]
        for browser in list(state.browsers):
            browser.write_message(frame, binary=True)


async def main(port: int, source_number: int) -> None:
    """Serve until standard input ends."""
    try:
        sockets = tornado.netutil.bind_sockets(port, "127.0.0.1")
    except OSError as error:
        print(json.dumps({"error": error.strerror or str(error)}), flush=True)
        return
    print(json.dumps({"port": sockets[0].getsockname()[1]}), flush=True)
    stream = sys.stdin.buffer
    state = State(stream.read(int.from_bytes(stream.read(8), "big")))
    application = tornado.web.Application([("/", Page, {"state": state}), ("/frames", Frames, {"state": state})])
    server = tornado.httpserver.HTTPServer(application)
    server.add_sockets(sockets)
    loop = asyncio.get_running_loop()
    source = socket.socket(fileno=source_number)
    source.setblocking(False)
    loop.add_reader(source.fileno(), forward, source, state)
    done = asyncio.Event()
    loop.add_reader(sys.stdin.fileno(), lambda: None if os.read(sys.stdin.fileno(), 4096) else done.set())
    await done.wait()


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), int(sys.argv[2])))
