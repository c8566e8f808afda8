"""The gains of a law for a bandwidth and a damping ratio."""

from __future__ import annotations

import numpy as np

from phcontrol.controllers.cartesian_law import CartesianLaw
from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.controllers.integral_action import IntegralAction
from phcontrol.controllers.total_force_rejection import TotalForceRejection
from phcontrol.design.design_problem import DesignProblem
from phcontrol.design.hand_gains import hand_gains
from phcontrol.design.specification import Choice
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.poles.force_feedback_poles import ForceFeedbackPoles
from phcontrol.poles.integral_action_poles import IntegralActionPoles
from phcontrol.poles.placed_matrices import placed_matrices
from phcontrol.poles.poles import Poles
from phcontrol.poles.second_order_poles import SecondOrderPoles

_POLES: tuple[tuple[type[Controller], type[Poles]], ...] = (
    (EnergyShaping, SecondOrderPoles),
    (ClassicalImpedance, SecondOrderPoles),
    (ForceFeedback, ForceFeedbackPoles),
    (IntegralAction, IntegralActionPoles),
)
_FRICTIONLESS = (TotalForceRejection, ClassicalImpedance)
"""Laws that cancel the friction."""


def poles_of(law: type[Controller]) -> type[Poles] | None:
    """Return how the poles of a law of the joints are placed; None where it is not known."""
    return next((poles for kind, poles in _POLES if issubclass(law, kind)), None)


def placed_gains(
    problem: DesignProblem, bandwidth: float, damping_ratio: float, *, further: float = 1.0, diagonal: bool = False
) -> Choice:
    """Return gains that put the poles of the loop about its rest where they should be.

    Args:
        problem: the law and the arm.
        bandwidth: ω [rad/s].
        damping_ratio: ζ.
        further: where the first of the poles is that a law's own states bring, over ω.
        diagonal: diagonal gains, which put the slowest mode there, in place of matrices, which put all.

    Raises:
        InvalidArgumentError: for laws whose poles it cannot place.
    """
    law = problem.law
    if issubclass(law, CartesianLaw):
        if diagonal:
            raise InvalidArgumentError("diagonal", f"is of the joints, and {problem.name} has a spring on the hand")
        return hand_gains(problem, bandwidth, damping_ratio)
    kind = poles_of(law)
    if kind is None:
        known = "energy shaping, force feedback, integral action, total-force rejection, classical and Cartesian laws"
        raise InvalidArgumentError(
            "controller",
            f"'{problem.name}' is none of the laws whose poles are placed ({known}): "
            "take one of these, or look for gains of any law from Python, with phcontrol.tune",
        )
    for name in kind.arguments():
        if problem.options.get(name) is not None:
            raise InvalidArgumentError(name, f"is what the poles of {problem.name} are placed with: leave it out")
    poles = kind(bandwidth, damping_ratio, further)
    inertia, friction = problem.state.mass_matrix, problem.friction
    if issubclass(law, _FRICTIONLESS):
        friction = np.zeros_like(friction)
    through = None if issubclass(law, ClassicalImpedance) else problem.state.input_matrix
    gains, found, damped = placed_matrices(poles, inertia, friction, through, diagonal=diagonal)
    placed = np.concatenate([each.poles for each in found])
    notes, exact = [], all(each.exact for each in found)
    if diagonal:
        notes.append("diagonal gains put the mode of the heaviest direction there: the others are faster")
        placed = np.zeros(0, dtype=complex) if friction.any() else found[0].poles
    elif problem.system.robot.continuous.any():
        notes.append("K_p couples continuous joints to others: H_d jumps where one is half a turn off its goal")
    if not exact:
        least = float(damped.max()) / (2.0 * poles.damping_ratio)
        notes.append(
            f"in {sum(not each.exact for each in found)} of {len(found)} directions the friction around rest alone "
            f"damps more than is desired (not from {least:.3g} rad/s on): there the slower pole is put where it should "
            "be, and ζ is larger"
        )
    return Choice(gains, placed, exact, tuple(notes))
