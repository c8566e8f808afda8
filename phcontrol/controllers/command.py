"""What a controller orders."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array


class Command(NamedTuple):
    """What a controller orders: a torque and the rate of its own state.

    Example:
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping.tuned(system, system.robot.home)
        >>> command = law.evaluate(0.0, system.at(system.robot.home), np.zeros(0))
        >>> np.allclose(command.torque, system.at(system.robot.home).potential_gradient), command.state_rate.size
        (True, 0)
    """

    torque: Array
    """u, shape (n,) [N·m]."""
    state_rate: Array
    """Rate of the controller's state, same shape as the state."""
