"""Every study by name, in the thesis's order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from phcontrol._validation import choice
from phcontrol.experiments.study import Outcome


@dataclass(frozen=True)
class Study:
    """A study and the module that runs it."""

    module: str
    summary: str

    @property
    def run(self) -> Callable[[], Outcome]:
        """The function that runs it; its module is loaded now, not before."""
        function: Callable[[], Outcome] = import_module(f"phcontrol.experiments.{self.module}").run
        return function


STUDIES: dict[str, Study] = {
    "fig-3-1": Study("fig_3_1", "position control of the shoulder under a constant force (thesis figure 3.1)"),
}


def run_study(name: str) -> Outcome:
    """Run a study by name. Raises UnknownNameError, listing the studies."""
    return STUDIES[choice("study", name, STUDIES)].run()
