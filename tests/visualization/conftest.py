"""A headless browser for the tests of pages, and runs to show."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from phcontrol import MechanicalSystem, RigidBody, SphereContact, Wrench, load_robot, make_controller, simulate

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


GOAL = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]


@pytest.fixture(scope="session")
def log():
    """The PERA is pulled at its hand, down onto a table below its tool, and sideways."""
    system = MechanicalSystem(load_robot("pera"))
    tip = system.robot.placement("tool", GOAL).translation
    table = SphereContact("tool", 0.01, "plane", position=tip - [0.0, 0.0, 0.03])
    return simulate(
        system,
        make_controller("force_feedback", system, goal=GOAL),
        duration=2.0,
        dt=4e-3,
        q0=np.array(GOAL) - [0.2, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
        bodies=[RigidBody(table, stiffness=1e3, damping=20.0)],
        disturbance=Wrench("hand", lambda t: [5.0 * np.sin(t), 0.0, -25.0, 0.0, 0.0, 0.0]),
    )
