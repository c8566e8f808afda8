"""Ctrl-C where compiled code would swallow it, and while modules are imported."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from phcontrol._interrupts import uninterrupted

ROOT = Path(__file__).parents[1]


def test_an_interrupt_waits_until_it_may_come():
    done = []

    def work():
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            done.append(1)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == [1]
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)  # the handler is what it was


def test_an_error_inside_is_not_lost():
    with pytest.raises(ZeroDivisionError), uninterrupted():
        raise ZeroDivisionError


def test_another_thread_is_let_be():
    failed = []

    def work():
        try:
            with uninterrupted():
                pass
        except ValueError as error:  # signals are the main thread's
            failed.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert failed == []


IMPORT_OF_A_MODULE_THAT_SWALLOWS = """
import os, signal, sys, time
sys.path.insert(0, {folder!r})
from phcontrol._interrupts import uninterrupted
from phcontrol.cli import interrupts
interrupts.wait_for_imports()
try:
    import swallows  # is interrupted, and would go on as if nothing had been
    with uninterrupted():
        end = time.monotonic() + 0.1
        while time.monotonic() < end:
            pass
        print("done")
    while True:
        pass
except KeyboardInterrupt:
    print("whole" if swallows.whole else "cut")
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers here")
def test_an_import_is_finished_before_an_interrupt_comes(tmp_path):
    (tmp_path / "swallows.py").write_text(
        "import os, signal\nwhole = False\ntry:\n    os.kill(os.getpid(), signal.SIGINT)\n"
        "    for _ in range(1000): pass\n    whole = True\nexcept BaseException:\n    pass\n"
    )
    program = IMPORT_OF_A_MODULE_THAT_SWALLOWS.format(folder=str(tmp_path))
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ran = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=60)
    assert ran.stdout.split() == ["done", "whole"], ran.stderr
