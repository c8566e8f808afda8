"""How the scenarios of a search are simulated."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from phcontrol.compilation.errors import CompilationWarning
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.simulate_many import simulate_many


def compiled(law: Controller, scenario: Any) -> Any:
    """Return the log of a run of a sweep. Raises PHControlError where it failed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CompilationWarning)
        (outcome,) = simulate_many(**scenario, controller=law, workers=1, progress=False)
    if outcome.error:
        raise PHControlError(outcome.error)
    return outcome.value


def simulated(law: Controller, scenario: Any) -> Any:
    """Return the log of the law on its own model, or on the scenario's ``system``."""
    return simulate(**arguments_of(law, scenario))


def arguments_of(law: Controller, scenario: Any) -> dict[str, Any]:
    """Return a scenario as arguments of ``simulate``."""
    if not isinstance(scenario, Mapping):
        raise InvalidArgumentError(
            "over", f"must hold dictionaries for simulate(), but one is {type(scenario).__name__}"
        )
    if "controller" in scenario:
        raise InvalidArgumentError("over", "has a controller of its own, and what is tuned is the one that is given")
    return {"system": law.system, "controller": law} | dict(scenario)
