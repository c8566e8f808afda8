"""The base of laws whose virtual position a regulation of the contact force may move."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.aim import Aim, LedAim
from phcontrol.controllers.force_regulation import ForceRegulation
from phcontrol.controllers.parameters import Parameter
from phcontrol.controllers.position_law import PositionLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import DrivenParts
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured

VIRTUAL_POSITION = "virtual_position"
"""The state in which a regulation keeps how far it has moved q_f."""


def _regulation(name: str, value: object, system: MechanicalSystem) -> ForceRegulation:
    if not isinstance(value, ForceRegulation):
        raise InvalidArgumentError(name, f"must be a ForceRegulation, but is {type(value).__name__}")
    if value.force.size != system.n:
        raise InvalidArgumentError(name, f"is for {value.force.size} joints, the system has {system.n}")
    return value


class RegulatedLaw(PositionLaw):
    """Laws about a virtual position q_f, which with ``regulation`` moves until the contact force is the desired one.

    How far q_f has moved is a state of the law, promised as what it is: driven by f_e − f_d. That may put energy in;
    ``with_tank`` makes a law of it whose energy tank pays.

    Args:
        regulation: the outer integrator, or None.
    """

    regulation: Parameter[ForceRegulation | None, ForceRegulation | None] = Parameter(default=None, check=_regulation)

    def prepare(self) -> None:
        """Check that there is a virtual position to move."""
        super().prepare()
        if self.regulation is not None and self._spring is None:
            raise InvalidArgumentError("regulation", "moves the goal of a joint spring: give goal and stiffness")

    @property
    def states(self) -> tuple[str, ...]:
        """With regulation, how far q_f has moved."""
        return () if self.regulation is None else (VIRTUAL_POSITION,)

    @property
    def caveat(self) -> str:
        """Say that regulation puts energy in."""
        return "" if self.regulation is None else "the moving virtual position supplies energy (with_tank: not)"

    @property
    def driven_by(self) -> str:
        """With regulation, the error of the contact force."""
        return super().driven_by if self.regulation is None else "f_e − f_d, which moves the virtual position"

    @property
    def lacks_minimum(self) -> str:
        """With regulation the law rests in contact only."""
        if self.regulation is None:
            return super().lacks_minimum
        return "stability in contact: it rests where the body it touches answers with f_d"

    def desired_posture(self, t: float, state: Array) -> Array | None:
        """Return q_f, as far as it has moved [rad]."""
        posture = super().desired_posture(t, state)
        return posture if posture is None or self.regulation is None else posture + state[self._moved]

    @property
    def _moved(self) -> slice:
        """Where in the law's own state is how far q_f has moved."""
        start = self.system.n * self.states.index(VIRTUAL_POSITION)
        return slice(start, start + self.system.n)

    @abstractmethod
    def spring_force(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return what H_d falls by as q_f moves, ∂H_d/∂(error), shape (n,) [N·m]."""

    def with_faster_goal(self, law: Shaping, rate: Array) -> Shaping:
        """Return what is shaped, with q_f moving faster by a rate, shape (n,) [rad/s]."""
        rates = law.state_rate.copy()
        rates[self._moved] += rate
        return law._replace(state_rate=rates)

    def rest_force(self, x: MechanicalState) -> Array | None:
        """Return f_d, with regulation."""
        return None if self.regulation is None else self.regulation.force

    def aim_at_virtual_position(self, t: float, x: MechanicalState, moved: Array) -> Aim:
        """Return what is aimed at when q_f has moved by some way, shape (n,) [rad]; none without regulation."""
        aim = self.aim(t, x)
        if self._spring is None or self.regulation is None:
            return aim
        goal: Any = self._spring.goal if aim.goal is None else aim.goal
        velocity, acceleration = aim.reference_velocity, aim.reference_acceleration
        if velocity is None or acceleration is None:
            velocity = acceleration = np.zeros(self.system.n)
        return LedAim(x, self._spring, goal + moved, velocity, acceleration)

    def drive(self, t: float, x: MechanicalState, measured: Measured) -> DrivenParts | None:
        """Return how the moving q_f enters the parts of the target, and q̇_f."""
        if self.regulation is None:
            return super().drive(t, x, measured)
        if measured.external_force is None:
            return None
        one = np.eye(self.system.n)
        return {"error": -one, VIRTUAL_POSITION: one}, self.regulation.rate(measured.external_force)
