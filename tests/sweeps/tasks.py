"""Tasks and measures that other processes import."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def square(item):
    if item == 13:
        raise ValueError("thirteen")
    return item * item


def environment(item):
    print("this is no answer")
    return os.environ["OMP_NUM_THREADS"], os.getpid()


def killed_once(item):
    """Die the first time; ``item`` is a file that remembers."""
    mark = Path(item)
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def killed(item):
    os.kill(os.getpid(), signal.SIGKILL)


def slow(item):
    time.sleep(30.0)


def cannot_be_sent(item):
    return lambda: item


def reach(log):
    """How far the first joint goes."""
    return abs(log.position[:, 0]).max()


def often_wrong(log):
    if log.position[0, 0] > 0.0:
        raise KeyError("no such thing")
    return 1.0


def kills_its_process(log):
    os.kill(os.getpid(), signal.SIGKILL)


def waits(log):
    """Take a while, so that somebody can be killed meanwhile."""
    time.sleep(0.1)
    return log.position[-1, 0]
