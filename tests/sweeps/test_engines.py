"""Engines: every item is answered once, whatever becomes of a process."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from phcontrol import InvalidArgumentError
from phcontrol.sweeps.engine import EngineError
from phcontrol.sweeps.local_processes import LocalProcesses
from tests.sweeps import tasks


def test_every_item_is_answered_and_an_error_is_an_answer():
    found = {done.item: done for done in LocalProcesses(2).run(tasks.square, range(20))}
    assert {item: done.value for item, done in found.items() if item != 13} == {k: k * k for k in range(20) if k != 13}
    assert isinstance(found[13].error, ValueError)
    assert str(found[13].error) == "thirteen"


def test_processes_have_one_thread_and_what_they_print_is_no_answer():
    answers = [done.value for done in LocalProcesses(2).run(tasks.environment, range(6))]
    assert {threads for threads, _ in answers} == {"1"}
    assert os.getpid() not in {process for _, process in answers}
    assert len({process for _, process in answers}) <= 2
    fresh = [done.value for done in LocalProcesses(2, fresh=True).run(tasks.environment, range(4))]
    assert len({process for _, process in fresh}) == 4


def test_a_task_whose_process_was_killed_is_begun_again_but_not_for_ever(tmp_path):
    (again,) = LocalProcesses(1).run(tasks.killed_once, [str(tmp_path / "mark")])
    assert (again.value, again.error) == ("alive", None)
    found = list(LocalProcesses(2).run(tasks.killed, [0, 1]))
    assert [done.item for done in sorted(found)] == [0, 1]
    for done in found:
        assert isinstance(done.error, EngineError)
        assert "was killed by signal 9 (out of memory?)" in str(done.error)


def test_what_cannot_be_sent_is_an_error():
    (done,) = LocalProcesses(1).run(tasks.cannot_be_sent, [1])
    assert "cannot be sent" in str(done.error)


def test_items_are_taken_as_they_are_needed_and_their_errors_are_raised():
    taken = []

    def items():
        for k in range(1000):
            taken.append(k)
            yield k

    running = LocalProcesses(1).run(tasks.square, items())
    next(running)
    running.close()
    assert len(taken) < 20

    def broken():
        yield 1
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        list(LocalProcesses(1).run(tasks.square, broken()))


def test_processes_end_when_the_iterator_is_closed():
    running = LocalProcesses(2).run(tasks.slow, range(4))
    began = time.monotonic()
    with pytest.raises(TimeoutError):
        _next_within(running, 1.0)
    assert time.monotonic() - began < 15.0


def _next_within(running, seconds):
    """Stop an iterator from another thread as the keyboard would: by an error in the one that waits."""
    import signal

    def stop(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        next(running)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_processes_end_with_the_one_that_started_them(tmp_path):
    code = (
        "import os, sys; from phcontrol.sweeps.local_processes import LocalProcesses; from tests.sweeps import tasks\n"
        "engine = LocalProcesses(1)\n"
        "for done in engine.run(tasks.environment, range(2)):\n"
        "    print(done.value[1], flush=True)\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    dead = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    child = int(dead.stdout.split()[0])
    for _ in range(100):
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return
        if (status := _state(child)) == "Z":  # waits for whoever adopted it
            return
        time.sleep(0.1)
    raise AssertionError(f"process {child} is still there: {status}")


def _state(process):
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"


@pytest.mark.parametrize("workers", [0, -1, 1.5, True])
def test_workers_are_a_count(workers):
    with pytest.raises(InvalidArgumentError, match="workers"):
        LocalProcesses(workers)
