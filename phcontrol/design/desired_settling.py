"""A stiffness of the hand, and within what time it settles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from phcontrol._validation import gain, positive
from phcontrol.controllers.cartesian_law import CartesianLaw
from phcontrol.design.design_problem import DesignProblem
from phcontrol.design.hand_gains import HandModes
from phcontrol.design.specification import Choice, Specification
from phcontrol.exceptions import InvalidArgumentError, PHControlError

BAND = 0.05
"""Of the way, within which a motion counts as settled."""
_TIMES = np.linspace(0.0, 40.0, 8001)  # over 1/ω


class DesiredSettling(Specification):
    """K_t and K_r of the hand, and the time within which every mode of it settles to 5 %.

    With B = 𝒥M⁻¹𝒥ᵀ the modes have ω² = eigenvalues of B K: a stiffness fixes them, and ζ is left to choose. Of all that
    settle in time the most damped is taken, ζ ≤ 1: the slowest mode decides. ζ = 0.69 settles soonest, at 2.9/ω; where
    that is too late, no damping settles in time, and the error says which stiffness would.

    Args:
        translational_stiffness: K_t, scalar, three numbers or a matrix, in the axes that the law takes it in [N/m].
        settling_time: [s].
        rotational_stiffness: K_r likewise [N·m/rad]; None leaves the orientation free.

    Example:
        >>> from phcontrol import DesiredSettling, MechanicalSystem, design_gains, load_robot
        >>> system = MechanicalSystem(load_robot("ur5"))
        >>> desired = DesiredSettling(600.0, 0.9, rotational_stiffness=60.0)  # [N/m], [s], [N·m/rad]
        >>> found = design_gains("cartesian_impedance", system, desired)
        >>> 0.69 < found.gains["damping_ratio"] <= 1.0
        True
    """

    def __init__(
        self, translational_stiffness: ArrayLike, settling_time: float, *, rotational_stiffness: ArrayLike | None = None
    ) -> None:
        self.translational_stiffness = gain("translational_stiffness", translational_stiffness, 3)
        self.rotational_stiffness = (
            None if rotational_stiffness is None else gain("rotational_stiffness", rotational_stiffness, 3)
        )
        self.settling_time = positive("settling_time", settling_time)

    def choose(self, problem: DesignProblem) -> Choice:
        """Return the stiffnesses and ζ."""
        if not issubclass(problem.law, CartesianLaw):
            raise InvalidArgumentError("controller", f"'{problem.name}' has no spring on the hand: cartesian_impedance")
        given = {
            "translational_stiffness": self.translational_stiffness, "rotational_stiffness": self.rotational_stiffness
        }  # fmt: skip
        hand = HandModes(problem.with_options(**given))
        linear, turning = self.translational_stiffness, self.rotational_stiffness
        if hand.law.axes == "tool":
            linear = hand.turn @ linear @ hand.turn.T
        if turning is not None:
            turning = hand.turn @ turning @ hand.turn.T
        K = hand.stiffness(linear, turning)
        frequencies = np.sqrt(hand.squares(K))
        allowed = self.settling_time * float(frequencies[0])
        ratio, soonest = _fastest_ratio(), settling_of(_fastest_ratio())
        if soonest > allowed:
            factor = (soonest / allowed) ** 2
            raise PHControlError(
                f"the hand's slowest mode is at {frequencies[0]:.3g} rad/s with this stiffness, and settles in "
                f"{soonest / frequencies[0]:.3g} s at the soonest, not in {self.settling_time:g} s: make the stiffness "
                f"{factor:.3g} times as large, or allow that time"
            )
        if settling_of(1.0) <= allowed:
            ratio = 1.0
        else:
            ratio = float(brentq(lambda each: settling_of(each) - allowed, ratio, 1.0))
        damping, exact, notes = hand.damping_arguments(K, ratio)
        gains = given | damping
        if len(hand.inertia) > hand.rows:
            gains["nullspace_damping"] = max(4.0, -math.log(BAND) / self.settling_time)
        poles = np.concatenate([np.roots([1.0, 2.0 * ratio * w, w**2]) for w in frequencies])
        return Choice(gains, poles.astype(complex), exact, notes)

    def __str__(self) -> str:
        """Return it in words."""
        return f"the hand's stiffness as given, settled to 5 % within {self.settling_time:g} s"


def settling_of(ratio: float) -> float:
    """Return when λ² + 2ζωλ + ω² has settled to 5 % from a displacement at rest, times ω."""
    t = _TIMES
    if abs(ratio - 1.0) < 1e-6:
        way = (1.0 + t) * np.exp(-t)
    elif ratio < 1.0:
        turned = math.sqrt(1.0 - ratio**2)
        way = np.exp(-ratio * t) * (np.cos(turned * t) + ratio / turned * np.sin(turned * t))
    else:
        root = math.sqrt(ratio**2 - 1.0)
        slow, fast = ratio - root, ratio + root
        way = (fast * np.exp(-slow * t) - slow * np.exp(-fast * t)) / (fast - slow)
    outside = np.flatnonzero(np.abs(way) > BAND)
    return float(t[outside[-1]])


def _fastest_ratio() -> float:
    """Return ζ with which a mode settles soonest: its first overshoot stays just below 5 %."""
    logarithm = math.log(BAND)
    return -logarithm / math.hypot(math.pi, logarithm) + 1e-4
