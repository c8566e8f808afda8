"""The process that serves a page and forwards frames to it. Run as a file: it needs Tornado, nothing of phcontrol.

Standard output: one JSON line, the port or an error; and one line more when a browser connects for the first time.
Standard input: the page's length (8 bytes, big-endian) and the page; when it ends, the server does, and also when its
parent has gone while something else holds the pipe open. Frames come as datagrams on the socket whose number is given,
an empty one at the end of the run; what browsers ask for goes back on it. A process of its own keeps all this out of
the control loop.

Only pages that came from here are answered: a name that someone else's server resolves to this machine shows in the
Host header, another page's script in the Origin.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import sys
from urllib.parse import urlsplit

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

HISTORY = 32 << 20
"""Bytes of frames kept for a browser that comes late; when there are more, every other one is dropped."""
BATCH = 1 << 18
"""Bytes sent to a browser before it has taken them."""
PATIENCE = 10.0
"""Time that a browser has to take a batch [s]; one that stands still longer is dropped."""
AT_ONCE = 1000
"""Frames taken before the browsers have their turn."""
LONGEST = 4096
"""Of what a browser may ask for at once [bytes]."""
ROOM = memoryview(bytearray(1 << 20))
"""For one frame as it comes: each is then kept in no more memory than it needs."""
NAMES = ("127.0.0.1", "localhost")
"""What this machine may be called in an address; the port may be another, as behind ``ssh -L``."""


class State:
    """What has come so far, and who watches."""

    def __init__(self, page: bytes, source: socket.socket) -> None:
        self.page, self.source, self.frames, self.size, self.ended, self.greeted = (
            page,
            source,
            list[bytes](),
            0,
            False,
            False,
        )
        self.browsers: set[Frames] = set()

    def add(self, frame: bytes) -> None:
        """Keep a frame."""
        self.frames.append(frame)
        self.size += len(frame)
        if self.size > HISTORY:
            del self.frames[1::2]
            self.size = sum(map(len, self.frames))
            for browser in self.browsers:
                browser.sent = (browser.sent + 1) // 2  # so many of the frames that it has are left

    def wake(self) -> None:
        """Let the browsers see what has come."""
        for browser in self.browsers:
            browser.news.set()


def is_ours(request: tornado.httputil.HTTPServerRequest) -> bool:
    """Return whether a request names this machine as its host, and comes from no other page."""
    try:
        name = urlsplit(f"//{request.headers.get('Host', '')}").hostname
    except ValueError:
        return False
    origin = request.headers.get("Origin")
    return name in NAMES and origin in (None, f"http://{request.headers['Host']}")


class Page(tornado.web.RequestHandler):
    """The page."""

    def initialize(self, state: State) -> None:
        """Keep what has come."""
        self.state = state

    def prepare(self) -> None:
        """Refuse what does not come from here."""
        if not is_ours(self.request):
            raise tornado.web.HTTPError(403)

    def get(self) -> None:
        """Send it."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")
        self.write(self.state.page)


class Frames(tornado.websocket.WebSocketHandler):
    """A browser that watches: it is sent what there is as fast as it takes it, and nothing is kept for it alone."""

    def initialize(self, state: State) -> None:
        """Keep what has come."""
        self.state, self.sent, self.news = state, 0, asyncio.Event()

    def prepare(self) -> None:
        """Refuse what does not come from here; a browser always says which page a socket is for."""
        if not is_ours(self.request) or "Origin" not in self.request.headers:
            raise tornado.web.HTTPError(403)

    def check_origin(self, origin: str) -> bool:
        """It is checked above."""
        return True

    def open(self, *args: str, **kwargs: str) -> None:
        """Begin with what has come so far; more follows."""
        self.set_nodelay(True)
        self.state.browsers.add(self)
        self.news.set()
        self.sending = asyncio.ensure_future(self.send())
        if not self.state.greeted:
            self.state.greeted = True
            print("connected", flush=True)

    async def send(self) -> None:
        """Send frame after frame until the run has ended or the browser has gone."""
        frames = self.state.frames
        try:
            while self in self.state.browsers:
                await self.news.wait()
                self.news.clear()
                while self.sent < len(frames):
                    batch, size = self.sent, 0
                    while batch < len(frames) and size < BATCH:
                        size += len(frames[batch])
                        batch += 1
                    message, self.sent = b"".join(frames[self.sent : batch]), batch
                    # shielded, for Tornado does not expect a write to be given up
                    await asyncio.wait_for(asyncio.shield(self.write_message(message, binary=True)), PATIENCE)
                if self.state.ended:
                    await self.write_message("end")
                    return
        except tornado.websocket.WebSocketClosedError:
            return
        except asyncio.TimeoutError:
            self.state.browsers.discard(self)
            self.close()  # cut off by Tornado when that is not answered either

    def on_message(self, message: str | bytes) -> None:
        """Hand on what it asks for; when the run does not take it, it is lost."""
        with contextlib.suppress(OSError):
            self.state.source.send(message.encode() if isinstance(message, str) else message)

    def on_close(self) -> None:
        """Forget it."""
        self.state.browsers.discard(self)
        self.news.set()


def forward(source: socket.socket, state: State) -> None:
    """Take frames that are there, and let the browsers know."""
    for _ in range(AT_ONCE):
        try:
            size = source.recv_into(ROOM)
        except BlockingIOError:
            break
        if not size:
            state.ended = True
            break
        state.add(bytes(ROOM[:size]))
    state.wake()


async def outlive(parent: int) -> None:
    """Wait until the parent has gone."""
    while os.getppid() == parent:
        await asyncio.sleep(0.5)


async def main(port: int, source_number: int, parent: int) -> None:
    """Serve until standard input ends, or the parent."""
    try:
        sockets = tornado.netutil.bind_sockets(port, "127.0.0.1")
    except OSError as error:
        print(json.dumps({"error": error.strerror or str(error)}), flush=True)
        return
    print(json.dumps({"port": sockets[0].getsockname()[1]}), flush=True)
    loop, stream, gone = asyncio.get_running_loop(), sys.stdin.buffer, asyncio.ensure_future(outlive(parent))
    reading = loop.run_in_executor(None, lambda: stream.read(int.from_bytes(stream.read(8), "big")))
    await asyncio.wait({asyncio.ensure_future(reading), gone}, return_when=asyncio.FIRST_COMPLETED)
    if gone.done():
        os._exit(1)  # a thread waits for a page that will not come
    source = socket.socket(fileno=source_number)
    source.setblocking(False)
    state = State(reading.result(), source)
    routes = [("/", Page, {"state": state}), ("/frames", Frames, {"state": state})]
    application = tornado.web.Application(
        routes, log_function=lambda handler: None, websocket_max_message_size=LONGEST
    )  # a page from elsewhere may ask often
    server = tornado.httpserver.HTTPServer(application)
    server.add_sockets(sockets)
    loop.add_reader(source.fileno(), forward, source, state)
    loop.add_reader(sys.stdin.fileno(), lambda: None if os.read(sys.stdin.fileno(), 4096) else gone.cancel())
    await asyncio.wait([gone])
    os._exit(0)  # at once, for there is nothing to keep, and Tornado complains of what it could not send


if __name__ == "__main__":
    asyncio.run(main(*map(int, sys.argv[1:4])))
