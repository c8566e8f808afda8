"""Ctrl-C while modules are imported: it waits until they are.

An interrupt in the middle of an import may be swallowed there, or end the process with an abort: extension modules call
Python from where no exception may leave.
"""

from __future__ import annotations

import signal
from types import FrameType

_AGAIN = 0.02  # after how long it is looked again whether modules are still imported [s]
_IMPORTING = "<frozen importlib"  # how the file names of the import system's own frames begin


def wait_for_imports() -> None:
    """Let Ctrl-C raise KeyboardInterrupt where nothing is imported, or as soon as that is done.

    Does nothing where there are no timers (Windows), or where somebody else handles the signal.
    """
    if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
        signal.signal(signal.SIGALRM, lambda number, frame: signal.raise_signal(signal.SIGINT))


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _is_importing(frame):
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)
        return
    raise KeyboardInterrupt


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith(_IMPORTING):
            return True
        frame = frame.f_back
    return False
