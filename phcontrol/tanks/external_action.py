"""Any function's torque, paid for by a tank."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, number, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.tanks.action import Action


class ExternalAction(Action):
    """The torque of a Python function: learned, planned elsewhere, or made up.

    Whatever it asks for, the arm receives no more energy than the tank holds and the damping refills: in continuous
    time. A torque that is held for a period balances to the error of the hold only (:class:`EnergyTank`): let it change
    slowly with q̇ against the period.

    Args:
        function: (t, x) -> a, shape (n,) [N·m], with x the arm's ``MechanicalState``, whose arrays are read-only; it
            must depend on nothing else.
        duration: how long it goes on changing with time [s]; 0 for a function that does not use t.

    Raises:
        InvalidArgumentError: the function cannot be called, does not return n finite numbers, or writes to the state.

    Example:
        >>> import numpy as np
        >>> from phcontrol import ExternalAction, MechanicalSystem, load_robot
        >>> stir = ExternalAction(lambda t, x: 0.5 * np.cos(x.position))
        >>> stir.torque(0.0, MechanicalSystem(load_robot("pera_shoulder")).at([0.0, 0.0]))
        array([0.5, 0.5])
    """

    def __init__(self, function: Callable[[float, MechanicalState], ArrayLike], *, duration: float = 0.0) -> None:
        if not callable(function):
            message = f"must be callable with time and state, but is {type(function).__name__}"
            raise InvalidArgumentError("function", message)
        self.function = function
        self.duration = number("duration", duration, minimum=0.0)

    def check(self, system: MechanicalSystem) -> None:
        """Ask the function once, at the arm's home."""
        self.torque(0.0, system.at(system.robot.home))

    def torque(self, t: float, x: MechanicalState) -> Array:
        """Return what the function returns, shape (n,) [N·m]."""
        try:
            torque = self.function(t, _own_state(x))
        except ValueError as error:
            if "read-only" not in str(error):
                raise
            name = getattr(self.function, "__qualname__", type(self.function).__name__)
            message = f"'{name}' of an ExternalAction writes to the state that it is given: let it copy the array first"
            raise InvalidArgumentError("function", message) from error
        return vector("what the function of an ExternalAction returns", torque, x.system.n)


def _own_state(x: MechanicalState) -> MechanicalState:
    """Return the same state made of copies, whose arrays cannot be written to."""
    return _read_only(x.system.state_type)(x.system, x.position.copy(), x.velocity.copy())


_READ_ONLY: dict[type[MechanicalState], type[MechanicalState]] = {}


def _read_only(kind: type[MechanicalState]) -> type[MechanicalState]:
    """Return a kind of state that hands out its arrays read-only, made once."""
    if kind in _READ_ONLY:
        return _READ_ONLY[kind]

    def read(self: MechanicalState, name: str) -> Any:
        value = kind.__getattribute__(self, name)
        if type(value) is np.ndarray and value.flags.writeable:
            value = value.view()
            value.flags.writeable = False
        return value

    made = _READ_ONLY[kind] = type(kind.__name__, (kind,), {"__getattribute__": read, "__doc__": kind.__doc__})
    return made
