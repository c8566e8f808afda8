"""The command line; ``application`` lists its commands, and is imported when it is used."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from phcontrol.cli.interrupts import wait_for_imports

if TYPE_CHECKING:
    from phcontrol.cli.application import app

__all__ = ["app", "main"]

_INTERRUPTED = 130
"""Exit code of what Ctrl-C ended."""


def main() -> None:
    """Entry point of the ``phcontrol`` command; Ctrl-C ends it without a traceback, also while it is being imported."""
    try:
        wait_for_imports()
        from phcontrol.cli.application import run

        run()
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)


def __getattr__(name: str) -> Any:
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from phcontrol.cli.application import app

    return app
