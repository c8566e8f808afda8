"""A headless browser for the tests of pages."""

from __future__ import annotations

import base64
import gzip
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

CHROMIUM = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)
FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--enable-unsafe-swiftshader",
]


class Browser:
    """Opens pages, and keeps what went wrong on them and what they asked the network for."""

    def __init__(self, chromium):
        self._chromium = chromium

    @contextmanager
    def open(self, address, ready="window.phcontrol && phcontrol.frames > 0"):
        page = self._chromium.new_page(viewport={"width": 1280, "height": 760})
        page.problems, page.requests = [], []
        page.on("console", lambda message: page.problems.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: page.problems.append(str(error)))
        page.on("request", lambda request: page.requests.append(request.url))
        try:
            page.goto(str(address))
            if ready:
                page.wait_for_function(ready, timeout=60_000)
            yield page
        finally:
            page.close()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None and not os.environ.get("CI"):
        pytest.skip("needs Chromium: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield Browser(chromium)
        chromium.close()


def run_of(page):
    """Return the run that a page holds, as the text that the browser unpacks."""
    packed = re.search(r'<script id="run" type="application/gzip">([^<]+)<', page)[1]
    return gzip.decompress(base64.b64decode(packed)).decode()
