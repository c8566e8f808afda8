"""Running chosen tests in a forked child, up to the first failure."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable
from typing import Any, NoReturn

import pytest
from hypothesis import Phase, settings

PYTEST = ["-q", "-s", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning"]
STARTING = 60.0  # of the processor [s], to import and collect


def forked(run: Callable[[int], Any]) -> tuple[int, bytes]:
    """Call ``run(pipe)`` in a child without output; return its exit code and what it wrote into the pipe."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        os.close(reading)
        code = 70
        with contextlib.suppress(Exception):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
            os.set_inheritable(writing, False)
            code = int(run(writing) or 0)
        os._exit(code)
    os.close(writing)
    status, written = None, b""
    os.set_blocking(reading, False)
    while status is None:
        with contextlib.suppress(BlockingIOError):
            written += os.read(reading, 1 << 20)
        done, raw = os.waitpid(child, os.WNOHANG)
        if done:
            status = os.waitstatus_to_exitcode(raw)
        else:
            time.sleep(0.003)
    with contextlib.suppress(BlockingIOError):
        while chunk := os.read(reading, 1 << 20):
            written += chunk
    os.close(reading)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)  # what the tests left behind
    return status, written


def set_limit(usual: float) -> None:
    """End this child when a test that usually takes ``usual`` of the processor [s] takes many times that, or waits.

    Of the clock it may take far more: on a busy computer a test that is right waits, too.
    """
    signal.setitimer(signal.ITIMER_PROF, 10.0 + 10.0 * usual)
    signal.setitimer(signal.ITIMER_REAL, 300.0 + 10.0 * usual)


class Chosen:
    """A pytest plugin: of what is collected only the chosen tests, in the order given, up to the first failure."""

    def __init__(self, usual: dict[str, float], pipe: int) -> None:
        self.usual, self.pipe = usual, pipe

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        found = {item.nodeid: item for item in items}
        items[:] = [found[name] for name in self.usual if name in found]
        tame_hypothesis(items)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> None:
        set_limit(self.usual[item.nodeid])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            leave(self.pipe, report.nodeid)


def leave(pipe: int, name: str) -> NoReturn:
    """End this child: a test failed."""
    os.write(pipe, name.encode())
    os._exit(1)


def tame_hypothesis(items: list[pytest.Item]) -> None:
    """Let Hypothesis try the same examples each time, and not look for the smallest one that fails."""
    for item in items:
        function = getattr(getattr(item, "obj", None), "__func__", getattr(item, "obj", None))
        usual = getattr(function, "_hypothesis_internal_use_settings", None)
        if usual is not None:
            phases = (Phase.explicit, Phase.generate)
            tamed = settings(usual, derandomize=True, database=None, phases=phases)
            function._hypothesis_internal_use_settings = tamed


def run_in_tree(tree: str, files: list[str], usual: dict[str, float], pipe: int) -> int:
    """Import everything anew from a tree of files and run the chosen tests."""
    os.chdir(tree)
    os.environ |= {"PYTHONPATH": tree, "PYTHONDONTWRITEBYTECODE": "1"}
    sys.dont_write_bytecode = True
    sys.path.insert(0, tree)
    signal.setitimer(signal.ITIMER_PROF, STARTING)
    return int(pytest.main([*PYTEST, "--rootdir", tree, f"--basetemp={tree}.tmp", *files], [Chosen(usual, pipe)]))
