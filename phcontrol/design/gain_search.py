"""An objective over scenarios as a function of gains."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.analysis.linearization import linearize
from phcontrol.compilation.errors import CompilationError
from phcontrol.controllers.controller import Controller
from phcontrol.design.scenario_runs import arguments_of, compiled, simulated
from phcontrol.design.smooth_objective import SmoothObjective
from phcontrol.design.trial import Trial
from phcontrol.exceptions import PHControlError
from phcontrol.simulation.sensitivity import gradient_along

REFUSED = 1e30
"""In place of infinity, with which a search cannot calculate."""
GRADIENT_TOLERANCE = 1e-6
"""By how much a gradient may differ from differences of the objective, relatively."""
_STEPS = (1e-3, 1e-5)  # of those differences: the small one where torques begin to be clipped
_FLAT = 1e-3  # of the objective: what a gradient is compared with at least

Runner = Callable[[Controller, Any], Any]


class GainSearch:
    """The objective as a function of the factors' logarithms, with a memory."""

    def __init__(
        self,
        law: Controller,
        names: tuple[str, ...],
        per_joint: bool,
        scenarios: list[Any],
        objective: Callable[[Any], float],
        run: Runner | None,
        combine: str,
        period: float | None,
        delay: int,
    ) -> None:
        self.law, self.names, self._scenarios, self._objective = law, names, scenarios, objective
        self._run, self._is_simulated = run or simulated, run is None or run is compiled
        self._combine = np.mean if combine == "mean" else np.max
        self._period, self._delay = period, delay
        self._begun = {name: np.array(getattr(law, name), dtype=float) for name in names}
        self._each = law.system.n if per_joint else 1
        self.history: list[Trial] = []
        """Every set of gains that was tried."""
        self.gradients, self.simulations = 0, 0
        """How many were computed, and how many runs were simulated for all of it, with their tangents or without."""
        self._last: tuple[bytes, list[Any]] | None = None

    @property
    def size(self) -> int:
        """How many factors there are."""
        return self._each * len(self.names)

    def gains(self, logarithms: Array) -> dict[str, Array]:
        """Return the gains."""
        made = {}
        for name, part in zip(self.names, np.split(np.asarray(logarithms), len(self.names)), strict=True):
            root = np.exp(0.5 * part)
            made[name] = self._begun[name] * (root[:, None] * root if len(root) > 1 else float(root[0]) ** 2)
        return made

    def cost(self, logarithms: Array) -> float:
        """Return the objective of all scenarios."""
        parts = np.split(np.exp(np.asarray(logarithms)), len(self.names))
        factors = {name: tuple(map(float, part)) for name, part in zip(self.names, parts, strict=True)}
        self._last = None
        value, reason = self._valued(logarithms)
        self.history.append(Trial(factors, value, reason))
        return value if math.isfinite(value) else REFUSED

    def gradient(self, logarithms: Array) -> Array:
        """Return the derivative of the objective of all scenarios. Raises CompilationError where there is none."""
        objective = self._objective
        assert isinstance(objective, SmoothObjective)
        point = np.asarray(logarithms)
        if self._last is None or self._last[0] != point.tobytes():
            law = self._at(point)
            self._last = point.tobytes(), [self._result(law, scenario) for scenario in self._scenarios]
        self.gradients += 1
        directions = [self._direction(point, axis) for axis in np.eye(self.size)]
        total = np.zeros(self.size)
        for scenario, log in zip(self._scenarios, self._last[1], strict=True):
            self.simulations += 1
            total += gradient_along(arguments_of(directions[0](0.0), scenario), log, objective.slopes(log), directions)
        return total / len(self._scenarios)

    def checked_gradient(self, logarithms: Array) -> Array:
        """Return the gradient, which is that of differences along a direction in which every gain changes.

        Raises CompilationError, which says why, where the objective has none.
        """
        if not isinstance(self._objective, SmoothObjective):
            raise CompilationError("the objective does not say its slopes")
        if not self._is_simulated:
            raise CompilationError("what is run is not known: it is the caller's own function")
        if len(self._scenarios) > 1 and self._combine is np.max:
            raise CompilationError("the largest of several objectives is not smooth")
        found = self.gradient(logarithms)
        along = np.where(np.arange(self.size) % 2, -1.0, 1.0)
        direction = self._direction(np.asarray(logarithms), along)
        unit = max(float(np.abs(found).sum()), _FLAT * abs(self.history[-1].value))
        for step in _STEPS:
            off = abs(central_difference(lambda h: self._value(direction(h)), step) - found @ along) / unit
            if off <= GRADIENT_TOLERANCE:
                return found
        raise CompilationError(f"the gradient differs from differences of the objective by {off:.1e}, relatively")

    def _direction(self, point: Array, along: Array) -> Callable[[float], Controller]:
        return functools.cache(lambda h: self._at(point + h * along))

    def _value(self, law: Controller) -> float:
        return float(np.mean([self._objective(self._result(law, scenario)) for scenario in self._scenarios]))

    def _at(self, logarithms: Array) -> Controller:
        return self.law.changed(**self.gains(logarithms))

    def _result(self, law: Controller, scenario: Any) -> Any:
        self.simulations += 1
        return self._run(law, scenario)

    def _valued(self, logarithms: Array) -> tuple[float, str]:
        try:
            law = self._at(logarithms)
            reason = self._unstable(law)
            if reason:
                return math.inf, reason
            results = [self._result(law, scenario) for scenario in self._scenarios]
            values = [float(self._objective(result)) for result in results]
        except PHControlError as error:
            return math.inf, str(error)
        if isinstance(self._objective, SmoothObjective):
            self._last = np.asarray(logarithms).tobytes(), results
        value = float(self._combine(values))
        return (value, "") if math.isfinite(value) else (math.inf, "the objective is not finite")

    def _unstable(self, law: Controller) -> str:
        """Return why a loop is not to be run; laws that follow something have no rest to look about."""
        if law.time_span or law.lacks_minimum.startswith("stability in contact"):
            return ""
        loop = linearize(law, law.system, exact=False)
        if (loop.eigenvalues.real - loop.uncertainty > 0.0).any():
            return "a mode of the loop about its rest grows"
        if self._period is not None and not loop.sampled(self._period, self._delay).stable:
            return f"the loop is not stable with a torque held for {self._period:g} s and {self._delay} periods late"
        return ""
