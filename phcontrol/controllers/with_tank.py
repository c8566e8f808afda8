"""Any law with an energy tank."""

from __future__ import annotations

from phcontrol.controllers.controller import Controller
from phcontrol.controllers.regulated_law import RegulatedLaw
from phcontrol.controllers.tanked_law import TankedLaw
from phcontrol.controllers.tanked_regulation import TankedRegulation
from phcontrol.exceptions import InvalidArgumentError

_MADE: dict[type[Controller], type[Controller]] = {}


def with_tank(law: type[Controller]) -> type[Controller]:
    """Return a law's class with ``actions`` and a ``tank`` among its arguments, which pays for a ``regulation`` too.

    Args:
        law: any law.

    Raises:
        InvalidArgumentError: no law.

    Example:
        >>> import numpy as np
        >>> from phcontrol import ExternalAction, ForceFeedback, MechanicalSystem, load_robot, with_tank
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> stirred = with_tank(ForceFeedback).tuned(system, actions=ExternalAction(lambda t, x: np.cos(x.position)))
        >>> stirred.states
        ('force', 'tank')
    """
    if not (isinstance(law, type) and issubclass(law, Controller)):
        raise InvalidArgumentError("law", f"must be the class of a law, but is {law!r}")
    if issubclass(law, TankedLaw):
        return law
    found = _MADE.get(law)
    if found is None:
        members = {"name": f"{law.name}_with_tank", "__doc__": law.__doc__, "__module__": law.__module__}
        tanked = TankedRegulation if issubclass(law, RegulatedLaw) else TankedLaw
        found = _MADE[law] = type(f"{law.__name__}WithTank", (tanked, law), members)
    return found
