"""The quantities that a sweep can vary."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from phcontrol.controllers.controller import Controller
from phcontrol.controllers.parameters import Flag, Gain, Matrix, NonNegative, Parameter, Positive, PositiveVector
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError
from phcontrol.mechanics.robot import Robot
from phcontrol.sweeps.distribution import Distribution

EACH = "each"
"""In the place of a joint: each of them, drawn independently."""


class Variable(NamedTuple):
    """What a quantity is, and which numbers it can be."""

    unit: str
    meaning: str
    minimum: float = -math.inf
    exclusive: bool = False
    """Whether the minimum itself is out of the domain."""
    of_joint: bool = False
    """Whether there is one for each joint: ``NAME.JOINT``."""
    listed: bool = False
    """Whether it can be a list or a grid only."""

    def check(self, distribution: Distribution) -> None:
        """Raise InvalidArgumentError where a distribution gives a number that the quantity cannot be."""
        low = distribution.support[0]
        if low < self.minimum or (self.exclusive and low == self.minimum and distribution.values is not None):
            wanted = f"{'>' if self.exclusive else '>='} {self.minimum:g}"
            unit = f" {self.unit}" if self.unit else ""
            advice = "" if distribution.values is not None else f": cut it off with minimum = {self.minimum:g}"
            raise InvalidArgumentError(
                distribution.name,
                f"must be {wanted}{unit} ({self.meaning}), but what is given goes down to {low:g}{advice}",
            )
        if self.listed and distribution.values is None:
            raise InvalidArgumentError(
                distribution.name, "must be a list of values or a grid: a whole multiple of dt is not drawn by chance"
            )


VARIABLES = {
    "initial_position": Variable("rad", "where a joint starts", of_joint=True),
    "initial_offset": Variable("rad", "how far from the nominal start a joint starts", of_joint=True),
    "initial_velocity": Variable("rad/s", "how fast a joint starts", of_joint=True),
    "payload_mass": Variable("kg", "a mass in the hand that the law does not know of", 0.0),
    "payload_x": Variable("m", "where the payload's centre of mass is, in the hand's axes"),
    "payload_y": Variable("m", "likewise"),
    "payload_z": Variable("m", "likewise"),
    "mass_factor": Variable("", "masses and inertias of all links over those that the law believes", 0.0, True),
    "link_mass_factor": Variable("", "likewise, of what moves with one joint", 0.0, True, of_joint=True),
    "friction_factor": Variable("", "friction of the joints over that which the law believes", 0.0),
    "viscous_friction": Variable("N·m·s/rad", "viscous friction of the joints, in place of the nominal one", 0.0),
    "coulomb_friction": Variable("N·m", "dry friction of the joints, likewise", 0.0),
    "sensor_noise": Variable("N·m", "standard deviation of what the force sensor of each joint shows", 0.0),
    "sensor_bias": Variable("N·m", "offset of what it shows"),
    "sensor_delay": Variable("s", "how late it shows it", 0.0),
    "position_noise": Variable("rad", "standard deviation of the position that the law is shown of each joint", 0.0),
    "position_bias": Variable("rad", "offset of the position that it is shown", of_joint=True),
    "position_resolution": Variable("rad", "step of the position that it is shown of each joint", 0.0),
    "velocity_noise": Variable("rad/s", "standard deviation of the velocity that it is shown of each joint", 0.0),
    "velocity_bias": Variable("rad/s", "offset of the velocity that it is shown", of_joint=True),
    "velocity_resolution": Variable("rad/s", "step of the velocity that it is shown of each joint", 0.0),
    "joint_delay": Variable("s", "how late it is shown positions and velocities", 0.0),
    "torque_delay": Variable("s", "how late a torque acts after it was ordered", 0.0, listed=True),
    "control_period": Variable("s", "time between two torques", 0.0, True, listed=True),
    "disturbance": Variable("N·m", "a torque that pushes a joint from outside", of_joint=True),
    "push_x": Variable("N", "a steady force on the hand, in the world's axes"),
    "push_y": Variable("N", "likewise"),
    "push_z": Variable("N", "likewise"),
    "disturbance_start": Variable("s", "when the disturbance of the joints begins", 0.0),
    "disturbance_duration": Variable("s", "how long it lasts", 0.0, True),
    "contact_stiffness": Variable("N/m or N·m/rad", "of the body that is touched", 0.0, True),
    "contact_damping": Variable("N·s/m or N·m·s/rad", "likewise", 0.0),
    "contact_position": Variable("m or rad", "where it is met: its height, or a joint's position"),
}
"""What can be varied, by name, beside the law's own gains: ``gain.NAME`` and ``gain_factor.NAME``."""


def numeric_gains(law: type[Controller]) -> dict[str, Parameter]:  # type: ignore[type-arg]
    """Return the arguments of a law that one number can stand for."""
    kinds = (Gain, Matrix, Positive, PositiveVector, NonNegative)
    return {name: one for name, one in law.parameters.items() if isinstance(one, kinds) and not isinstance(one, Flag)}


def variable_of(name: str, law: type[Controller], robot: Robot) -> Variable:
    """Return what a name stands for. Raises UnknownNameError, listing what there is."""
    head, _, tail = name.partition(".")
    gains = numeric_gains(law)
    if head in ("gain", "gain_factor"):
        if tail not in gains:
            raise UnknownNameError("gain", tail, gains, f" of {law.name}")
        parameter = gains[tail]
        factor = head == "gain_factor"
        exclusive = factor or isinstance(parameter, (Gain, Positive, PositiveVector))
        low = -math.inf if isinstance(parameter, Matrix) and not factor else 0.0
        return Variable("" if factor else parameter.unit, f"{tail} of the law", low, exclusive)
    variable = VARIABLES.get(head)
    if variable is None or (tail and not variable.of_joint):
        raise UnknownNameError("parameter", name, known_names(law))
    if variable.of_joint and tail != EACH:
        if not tail:
            raise InvalidArgumentError(name, f"is of a joint: {name}.{robot.joint_names[0]}, or {name}.{EACH}")
        robot.joint_index(tail)
    return variable


def known_names(law: type[Controller]) -> Iterable[str]:
    """Return everything that can be varied with a law."""
    names = [f"{name}.JOINT" if one.of_joint else name for name, one in VARIABLES.items()]
    gains = numeric_gains(law)
    return [*names, *(f"gain.{name}" for name in gains), *(f"gain_factor.{name}" for name in gains)]


def expanded(name: str, robot: Robot) -> list[str]:
    """Return the names that one stands for: ``initial_offset.each`` is one for each joint."""
    head, _, tail = name.partition(".")
    return [f"{head}.{joint}" for joint in robot.joint_names] if tail == EACH else [name]
