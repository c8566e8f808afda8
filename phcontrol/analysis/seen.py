"""One law asked at one state, with what it sees there: the questions of all checks."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.promise import Promise
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.controllers.aging import aging
from phcontrol.controllers.answers import commanded, stored
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.target import Target, check_target
from phcontrol.exceptions import AnswerError, InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured, measure_truly


class Seen:
    """A law at a state: its own view of the plant there, and what perfect sensors show it of the plant.

    Quantities of the view are computed once and serve all questions; ``elsewhere()`` gives a fresh one.
    """

    def __init__(self, law: Controller, at: SampledState, measured: Measured) -> None:
        self.law, self.at, self.measured = law, at, measured
        self.view = law.system.at(at.position, at.velocity)

    @classmethod
    def of(
        cls, law: Controller, plant: MechanicalSystem, at: SampledState, shown: Collection[str] | None = None
    ) -> Seen:
        """Return a law at a state of the plant; it is shown what it says it needs, or the quantities named."""
        x = plant.at(at.position, at.velocity)
        return cls(law, at, measure_truly(x, at.force, law.needs if shown is None else shown, at.scene))

    def elsewhere(self, **changed: Any) -> Seen:
        """Return the law in another state (fields of ``SampledState``) with the same measurements."""
        return Seen(self.law, self.at._replace(**changed), self.measured)

    def command(self) -> Command:
        """Return torque and state rate."""
        return commanded(self.law, self.at.time, self.view, self.at.state, self.measured)

    def rate(self, plant: MechanicalSystem) -> Array:
        """Return the rate of (q, q̇, controller state) in the true closed loop of a plant."""
        at, command = self.at, self.command()
        acceleration = plant.at(at.position, at.velocity).acceleration(command.torque, at.force)
        return np.concatenate([at.velocity, acceleration, command.state_rate])

    def stored(self) -> float:
        """Return H_d [J]. Raises AnswerError unless it is a finite number."""
        return stored(self.law, self.at.time, self.view, self.at.state, self.measured)

    def aging(self, step: float) -> float:
        """Return ∂H_d/∂t at the same coordinates [W], by differences with a step of time [s]."""
        at = self.at
        return aging(self.law, at.time, self.view, at.state, self.measured, self.promise().gradient, step)

    def coordinates(self) -> Array:
        """Return the target's coordinates."""
        return self.law.coordinates(self.at.time, self.view, self.at.state, self.measured)

    def promise(self) -> Promise:
        """Return the target's numbers. Raises AnswerError where they have wrong shapes or are not finite."""
        try:
            return Promise.of(self.target(), self.view.system.n)
        except AnswerError:
            raise
        except InvalidArgumentError as error:
            problem = str(error).removeprefix("target.").replace(": ", " ", 1)
            raise AnswerError(type(self.law), "target", f"returned a Target whose {problem}") from error

    def target(self) -> Target:
        """Return the target as the law states it."""
        target = self.law.target(self.at.time, self.view, self.at.state, self.measured)
        check_target(target, type(self.law))
        return target


def largest_difference(before: Sequence[Array], after: Sequence[Array]) -> float:
    """Return the largest difference of two lists of arrays, each relative to its own size, or to 1 where it is 0.

    Infinite for other shapes and for NaN.
    """
    worst = 0.0
    for a, b in zip(before, after, strict=True):
        if a.shape != b.shape:
            return np.inf
        scale = float(np.abs(a).max(initial=0.0)) or 1.0
        difference = float(np.abs(b - a).max(initial=0.0)) / scale
        worst = max(worst, np.inf if np.isnan(difference) else difference)
    return worst
