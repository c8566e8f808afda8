"""Gains from a specification."""

from __future__ import annotations

from typing import Any

from phcontrol.analysis.linearization import linearize
from phcontrol.design.design_problem import DesignProblem
from phcontrol.design.designed_gains import DesignedGains
from phcontrol.design.specification import Specification
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError
from phcontrol.mechanics.system import MechanicalSystem, check_system


def design_gains(
    controller: str,
    system: MechanicalSystem,
    specification: Specification,
    goal: Any = None,
    *,
    interconnection: str = "coriolis",
    **options: Any,
) -> DesignedGains:
    """Return the gains of a law with which its closed loop does what a specification asks for.

    What was achieved is looked at in the spectrum of the true loop (:func:`linearize`), not in the design.

    Args:
        controller: the law's name.
        system: the model of the arm.
        specification: :class:`DesiredBandwidth`, :class:`DesiredSettling`, :class:`DesiredGain`,
            :class:`TorqueBudget` or :class:`SamplingBudget`.
        goal: where the law rests, as ``make_controller`` takes it: the operating point.
        interconnection: which J̄₂ the law uses.
        options: further arguments of the law, which are not designed.

    Raises:
        UnknownNameError: an unknown law or option.
        InvalidArgumentError: the specification does not go with the law.
        PHControlError: no gains of the law do that on this arm; says what stands in the way.

    Example:
        >>> from phcontrol import DesiredBandwidth, MechanicalSystem, design_gains, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("ur5"))
        >>> found = design_gains("energy_shaping", system, DesiredBandwidth(8.0, 0.7))
        >>> {round(mode.damping_ratio, 3) for mode in found.spectrum}
        {0.7}
        >>> law = make_controller("energy_shaping", system, **found.gains)
    """
    check_system(system)
    if not isinstance(specification, Specification):
        raise InvalidArgumentError(
            "specification",
            f"must be one like DesiredBandwidth(6.0), but is {type(specification).__name__}",
        )
    problem = DesignProblem(controller, system, goal, interconnection, dict(options))
    for name in options:
        if name not in problem.law.parameters:
            raise UnknownNameError("option", name, list(problem.law.parameters), f" of {controller}")
    chosen = specification.choose(problem)
    law = problem.make(**chosen.gains)
    linear = None if law.time_span else linearize(law, system, exact=False)
    words = str(specification)
    return DesignedGains(controller, words, chosen.gains, law, linear, chosen.poles, chosen.exact, chosen.notes)
