"""What a torque must state that a tank pays for."""

from __future__ import annotations

from abc import ABC, abstractmethod

from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem


class Action(ABC):
    """A torque a(t, q, q̇) that is neither the gradient of a potential nor a damping, and so is not passive by itself.

    A pure function: the same arguments, the same torque.

    Example:
        >>> import numpy as np
        >>> from phcontrol import Action, EnergyShaping, MechanicalSystem, certify, load_robot, with_tank
        >>> class Wind(Action):
        ...     def torque(self, t, x):
        ...         return np.array([0.5, 0.0])  # [N·m]
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = with_tank(EnergyShaping).tuned(system, actions=[Wind()])
        >>> certify(law, system, samples=16).passed
        True
    """

    duration: float = 0.0
    """How long it goes on changing with time [s]; 0 for one that does not."""

    def check(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError or UnknownNameError when it does not fit this arm. By default all fit."""
        return

    @abstractmethod
    def torque(self, t: float, x: MechanicalState) -> Array:
        """Return a, as a force on the joints, shape (n,) [N·m]."""
