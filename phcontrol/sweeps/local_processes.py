"""Processes on this machine."""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Iterable
from typing import IO, Any

from phcontrol._validation import count, flag
from phcontrol.sweeps.engine import EngineError, Finished
from phcontrol.sweeps.worker import read_message, write_message

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""What a process is started with, so that its numbers depend neither on the others nor on their count."""
ATTEMPTS = 2
"""How often a task is begun whose process dies."""


class LocalProcesses:
    """An :class:`Engine`: tasks in processes on this machine, each with one thread.

    The processes import the modules of this one by its ``sys.path``, and never run its main module again: a program
    needs no ``if __name__ == "__main__"``. They end with it, however it ends.

    Args:
        workers: processes at a time; by default one for each processor that there is for this process.
        fresh: a new process for each task.
        attempts: how often a task is begun whose process dies.

    Example:
        >>> import math
        >>> from phcontrol import LocalProcesses
        >>> found = {done.item: done.value for done in LocalProcesses(2).run(math.sqrt, [4.0, 9.0])}
        >>> found == {4.0: 2.0, 9.0: 3.0}
        True
    """

    def __init__(self, workers: int | None = None, *, fresh: bool = False, attempts: int = ATTEMPTS) -> None:
        self.workers = processors() if workers is None else count("workers", workers)
        self._fresh, self._attempts = flag("fresh", fresh), count("attempts", attempts)

    def run(self, task: Callable[[Any], Any], items: Iterable[Any]) -> Generator[Finished, None, None]:
        """Yield what came of ``task(item)`` of each item, as they finish."""
        waiting, lock, stopped = iter(items), threading.Lock(), threading.Event()
        done: queue.Queue[Finished | BaseException | None] = queue.Queue(2 * self.workers)
        running: set[_Process] = set()

        def work() -> None:
            process: _Process | None = None
            try:
                while not stopped.is_set():
                    with lock:
                        item = next(waiting, done)
                    if item is done:
                        break
                    process, finished = self._attempt(task, item, process, running, stopped)
                    done.put(finished)
            except BaseException as error:  # of the items
                done.put(error)
            finally:
                if process is not None:
                    process.end()
                done.put(None)

        threads = [threading.Thread(target=work, name=f"worker {k}", daemon=True) for k in range(self.workers)]
        for thread in threads:
            thread.start()
        left = len(threads)
        try:
            while left:
                found = done.get()
                if found is None:
                    left -= 1
                elif isinstance(found, BaseException):
                    raise found
                else:
                    yield found
        finally:
            stopped.set()
            for process in list(running):
                process.end()
            while left:  # nobody waits for room in the queue
                left -= done.get() is None

    def _attempt(
        self, task: Any, item: Any, process: _Process | None, running: set[_Process], stopped: threading.Event
    ) -> tuple[_Process | None, Finished]:
        """Do a task, in another process where one died; return the process for the next."""
        for attempt in range(self._attempts):
            if process is None:
                process = _Process()
                running.add(process)
                if stopped.is_set():  # who stops us may have missed this one
                    process.end()
            try:
                value, error = process.ask(task, item)
            except (EOFError, OSError):
                reason = process.death()
                running.discard(process)
                process = None
                if attempt + 1 < self._attempts and not stopped.is_set():
                    continue
                return None, Finished(item, None, EngineError(reason))
            if self._fresh:
                process.end()
                running.discard(process)
                process = None
            return process, Finished(item, value, error)
        raise AssertionError


class _Process:
    """A process that does tasks (``worker``)."""

    def __init__(self) -> None:
        # the modules of this process, never those of a folder that it happens to be run in
        code = f"import sys; sys.path[:] = {sys.path!r}; from phcontrol.sweeps.worker import main; main()"
        self._ending = threading.Lock()
        self._complaints: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115, closed at its end
        self._process = subprocess.Popen(
            [sys.executable, "-c", code, str(os.getpid())],
            env=os.environ | ONE_THREAD,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._complaints,
            start_new_session=True,  # the keyboard's interrupt is ours to pass on
        )

    def ask(self, task: Any, item: Any) -> tuple[Any, Exception | None]:
        """Return what a task returned or raised. Raises EOFError or OSError where the process died."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        write_message(self._process.stdin, pickle.dumps((task, item)))
        answer: tuple[Any, Exception | None] = read_message(self._process.stdout)
        return answer

    def end(self) -> None:
        """End the process."""
        with self._ending:
            if self._process.poll() is None:
                self._process.terminate()
            self._process.wait()
            for file in (self._process.stdin, self._process.stdout, self._complaints):
                if file is not None:
                    with contextlib.suppress(OSError):  # what was still to be written
                        file.close()

    def death(self) -> str:
        """Return how a process ended that gives no answer any more."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5.0)
        lines: list[str] = []
        with self._ending:
            if not self._complaints.closed:
                self._complaints.seek(0)
                lines = self._complaints.read().decode(errors="replace").strip().splitlines()
        self.end()
        code = self._process.returncode
        how = f"was killed by signal {-code} (out of memory?)" if code < 0 else f"ended with code {code}"
        return f"its process {how}" + (f": {lines[-1]}" if lines else "")


def processors() -> int:
    """Return how many processors there are for this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
