"""Coulomb friction between a fingertip and a surface."""

from __future__ import annotations

import math

import numpy as np

from phcontrol._validation import Array, number, positive


class ContactFriction:
    """f = −μF v/sqrt(|v|² + v₀²): Coulomb's law, regularised, for a sliding velocity v and a normal force F.

    It opposes the motion always, so that it never creates energy. At |v| = v₀ it is 71 % of μF; held still under a
    smaller force the contact creeps, at v₀·f/sqrt((μF)² − f²).

    Args:
        coefficient: μ; 0 for none.
        slip_speed: v₀ [m/s]. About rest friction damps with μF/v₀: steps must be shorter than 2.8 m v₀/(μF) for the
            mass m that slides, with RK4.
    """

    def __init__(self, coefficient: float, slip_speed: float) -> None:
        self.coefficient = number("friction", coefficient, minimum=0.0)
        self.slip_speed = positive("slip_speed", slip_speed)

    def force(self, normal_force: float, velocity: Array) -> tuple[Array, float]:
        """Return f, shape (3,) [N], and the power −fᵀv ≥ 0 that it takes [W], at a sliding velocity [m/s]."""
        square = float(np.dot(velocity, velocity))
        resistance = self.coefficient * normal_force / math.sqrt(square + self.slip_speed**2)
        return -resistance * velocity, resistance * square
