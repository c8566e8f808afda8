"""The law that --controller names."""

from __future__ import annotations

from pathlib import Path

from phcontrol.controllers.registry import Entry, find_law

CONTROLLER_HELP = "see 'phcontrol controllers'; or one of your own, my_module:MyLaw"


def law_of(name: str) -> Entry:
    """Return a law by its name, or of a module that is looked for in the working directory first."""
    return find_law(name, str(Path.cwd()))
