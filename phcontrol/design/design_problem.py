"""The law and the arm that gains are looked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.registry import find_law, make_controller
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem


class DesignProblem:
    """A law by its name, the arm, and what is fixed already.

    Args:
        name: of the law.
        system: the model of the arm.
        goal: as ``make_controller`` takes it.
        interconnection: which J̄₂ the law uses.
        options: arguments of the law that are given.
    """

    def __init__(
        self, name: str, system: MechanicalSystem, goal: Any, interconnection: str, options: Mapping[str, Any]
    ) -> None:
        entry = find_law(name)
        self.name, self.system, self.goal, self.interconnection = name, system, goal, interconnection
        self.law: type[Controller] = entry.law
        """The law's class."""
        self.options: dict[str, Any] = entry.options | dict(options)
        """Those of the law's name, and those that are given."""

    def make(self, **gains: Any) -> Controller:
        """Return the law with some gains; the others are its default ones."""
        options = self.options | gains
        return make_controller(self.name, self.system, self.goal, interconnection=self.interconnection, **options)

    def with_options(self, **options: Any) -> DesignProblem:
        """Return the problem with more of the law's arguments given."""
        return DesignProblem(self.name, self.system, self.goal, self.interconnection, self.options | options)

    @lazy
    def posture(self) -> Array:
        """Where the law comes to rest [rad]: the operating point."""
        law = self.make()
        return np.array(law.rest_posture(law.time_span))

    @lazy
    def state(self) -> MechanicalState:
        """The arm at rest there."""
        return self.system.at(self.posture)

    @property
    def friction(self) -> Array:
        """D at rest, shape (n, n) [N·m·s/rad]."""
        return self.state.damping_matrix
