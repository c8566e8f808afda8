"""What tuning came to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.controller import Controller
from phcontrol.design.trial import Trial


@dataclass(frozen=True, eq=False)
class TunedGains:
    """Gains that make an objective small over scenarios.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, load_robot, tune
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> goal = system.robot.near_home()
        >>> scenarios = [{"q0": system.robot.home, "duration": 0.2, "dt": 2e-3}]
        >>> def error(log):
        ...     return float(np.linalg.norm(log.position[-1] - goal))
        >>> found = tune("energy_shaping", error, scenarios, system=system, goal=goal, evaluations=8)
        >>> found.value == min(trial.value for trial in found.history)
        True
    """

    law: Controller = field(repr=False)
    """The law with these gains."""
    gains: dict[str, Array]
    """Those that were tuned, as keyword arguments."""
    value: float
    """Of the objective."""
    start_value: float
    """With the gains that it began with."""
    history: tuple[Trial, ...] = field(repr=False)
    """Every set of gains that was tried, in order; the first are those that it began with."""
    converged: bool
    """Whether the search ended by itself, and not with its last evaluation."""
    method: str
    """"gradient", "nelder-mead" or "evolution"."""
    reason: str
    """Why gradients were not used, or not to the end; "" where they were, or another method was asked for."""
    gradients: int
    """How many gradients were computed."""
    simulations: int
    """How many runs were simulated: of trials, gradients, and the differences that the first gradient is checked by."""

    @property
    def factors(self) -> dict[str, tuple[float, ...]]:
        """Of the gains, over those that it began with."""
        return min(self.history, key=lambda trial: trial.value).factors

    @property
    def refused(self) -> tuple[Trial, ...]:
        """Gains that were refused."""
        return tuple(trial for trial in self.history if trial.reason)

    def __str__(self) -> str:
        """Return it in words."""
        end = "converged" if self.converged else "stopped at the number of evaluations that was allowed"
        lines = [
            f"{self.law.name} on {self.law.system.robot.name}: {self.start_value:.4g} -> {self.value:.4g} in "
            f"{len(self.history)} evaluations ({len(self.refused)} refused) and {self.gradients} gradients, by "
            f"{self.method}, {self.simulations} runs: {end}"
        ]
        if self.reason:
            lines.append(f"  without gradients: {self.reason}")
        for name, factors in self.factors.items():
            lines.append(f"  {name} times {np.array2string(np.array(factors), precision=3)}")
        return "\n".join(lines)
