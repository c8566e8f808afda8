"""Trials on tests collected once: a mutated function is put in the place of the right one, in a forked child."""

from __future__ import annotations

import gc
import importlib
import json
import multiprocessing
import os
import random
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import coverage
import pytest
from trial import PYTEST, forked, leave, set_limit, tame_hypothesis


def measurement(tree: Path) -> coverage.Coverage:
    """Return a recorder of the lines of phcontrol that are executed."""
    recorder = coverage.Coverage(data_file=None, config_file=False, include=[f"{tree}/phcontrol/*"])
    recorder.set_option("run:disable_warnings", ["no-data-collected"])  # a test may look at definitions alone
    return recorder


def executed_by(recorder: coverage.Coverage, tree: Path) -> dict[str, dict[str, set[int]]]:
    """Return what was recorded while modules of tests were imported: for each of them, for each module, the lines."""
    data, found = recorder.get_data(), defaultdict(lambda: defaultdict(set))
    for file in data.measured_files():
        module = str(Path(file).relative_to(tree))
        for line, contexts in data.contexts_by_lineno(file).items():
            for context in contexts:
                found[context][module].add(line)
    return found


def executed(recorder: coverage.Coverage, tree: Path) -> dict[str, list[int]]:
    """Return what was recorded: for each module the lines."""
    data = recorder.get_data()
    return {str(Path(file).relative_to(tree)): sorted(data.lines(file) or []) for file in data.measured_files()}


class CollectedTests:
    """The tests of a tree, collected in this process."""

    def __init__(self, tree: Path, items: list[pytest.Item], recorder: coverage.Coverage) -> None:
        self.tree = tree
        self.imported = executed(recorder, tree)
        self.imported_by = executed_by(recorder, tree)
        self.items = {item.nodeid: item for item in items}
        self.warmed: dict[str, list[int]] = {}
        self.failed = ""
        tame_hypothesis(items)
        self._functions: dict[tuple[str, str, int], list[FunctionType]] = {}
        for function in gc.get_objects():
            if isinstance(function, FunctionType) and function.__code__.co_filename.startswith(str(tree)):
                self._functions.setdefault(_key(function.__code__), []).append(function)
        gc.collect()
        gc.freeze()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Remember a failure (called by pytest, where this is a plugin)."""
        if report.failed:
            self.failed = report.nodeid

    def warm_up(self) -> None:
        """Load the arms that tests share, so that no child need; what that executes cannot be tried here."""
        recorder = measurement(self.tree)
        recorder.start()
        conftest = importlib.import_module("tests.conftest")
        for arm in conftest.ARMS:
            conftest.make_system(arm)
        recorder.stop()
        self.warmed = executed(recorder, self.tree)
        gc.collect()
        gc.freeze()

    def record(self, name: str, longest: float) -> dict[str, Any]:
        """Run one test by itself; return whether it passed, its processor time [s] and the lines it executed.

        And whether it started a process, whose lines are not seen. One that takes more than ``longest`` of the
        processor [s] is given up, as one that failed.
        """

        def run(pipe: int) -> int:
            started = []
            sys.addaudithook(lambda event, _: started.append(event) if event == "subprocess.Popen" else None)
            start = BaseProcess.start
            BaseProcess.start = lambda process: (started.append("start"), start(process))[1]  # type: ignore[method-assign]
            signal.setitimer(signal.ITIMER_REAL, 900.0)
            signal.setitimer(signal.ITIMER_PROF, longest)
            recorder = measurement(self.tree)
            item, begin = self.items[name], time.process_time()
            recorder.start()
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
            recorder.stop()
            seconds = time.process_time() - begin
            lines = executed(recorder, self.tree)
            found = {"passed": not self.failed, "seconds": round(seconds, 3), "starts": bool(started), "lines": lines}
            data = json.dumps(found).encode()
            while data:
                data = data[os.write(pipe, data) :]
            return 0

        status, written = forked(run)
        return json.loads(written) if status == 0 else {"passed": False, "seconds": 0.0, "starts": False, "lines": {}}

    def has(self, module: str, function: CodeType) -> bool:
        """Report whether a module's function exists once and for all, so that it can be replaced."""
        return _key(function, str(self.tree / module)) in self._functions

    def run(self, module: str, before: CodeType, after: CodeType, usual: dict[str, float]) -> tuple[int, str]:
        """Run tests (with the times [s] they usually take) on a function's mutant; return exit code and failed test."""

        def run(pipe: int) -> int:
            for function in self._functions[_key(before, str(self.tree / module))]:
                function.__code__ = after.replace(co_filename=function.__code__.co_filename)
            chosen = [self.items[name] for name in usual if name in self.items]
            for item, following in zip(chosen, [*chosen[1:], None], strict=True):
                set_limit(usual[item.nodeid])
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if self.failed:
                    leave(pipe, self.failed)
            return 0

        status, written = forked(run)
        return status, written.decode()


def _key(code: CodeType, file: str = "") -> tuple[str, str, int]:
    return file or code.co_filename, code.co_qualname, code.co_firstlineno


def some_cases(items: list[pytest.Item], most: int) -> list[pytest.Item]:
    """Return the tests with at most a number of cases of each parametrised one, drawn at random; 0 for all."""
    cases = defaultdict(list)
    for item in items:
        cases[item.nodeid.partition("[")[0]].append(item)
    generator = random.Random(0)
    kept = {
        id(item) for own in cases.values() for item in (own if not most else generator.sample(own, min(most, len(own))))
    }
    return [item for item in items if id(item) in kept]


def collect(tree: Path, tests: list[str], work: Callable[[CollectedTests], None], most: int) -> int:
    """Import phcontrol from a tree, collect tests there and call ``work`` with them; return pytest's exit code."""
    os.chdir(tree)
    os.environ["PYTHONPATH"] = str(tree)
    sys.path.insert(0, str(tree))
    multiprocessing.set_start_method("fork", force=True)
    recorder = measurement(tree)
    recorder.start()

    class Plugin:
        def pytest_collectstart(self, collector: pytest.Collector) -> None:
            if isinstance(collector, pytest.Module):
                recorder.switch_context(str(collector.path.relative_to(tree)))

        def pytest_runtestloop(self, session: pytest.Session) -> bool:
            recorder.stop()
            assert not session.testsfailed, "some tests cannot be collected"
            collected = CollectedTests(tree, some_cases(session.items, most), recorder)
            session.config.pluginmanager.register(collected)
            work(collected)
            return True

    for path in sorted((tree / "phcontrol").rglob("*.py")):
        __import__(".".join(path.relative_to(tree).with_suffix("").parts).removesuffix(".__init__"))
    return int(pytest.main([*PYTEST, "--rootdir", str(tree), f"--basetemp={tree}.tmp", *tests], [Plugin()]))
