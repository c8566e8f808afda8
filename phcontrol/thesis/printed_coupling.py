"""The compliant body coupled to the gripper as (4.65) and (4.66) print it."""

from __future__ import annotations

import math

import numpy as np

from phcontrol._validation import Array, positive
from phcontrol.environments.body import Body, Touch
from phcontrol.environments.contact_geometry import JointContact, effective_mass
from phcontrol.mechanics.state import MechanicalState


class PrintedCoupling(Body):
    """The mass, spring and damper of (4.62) to (4.64), with f_e = −y_c and u_c = y_g.

        ṡ = p/m_c,   ṗ = −K_c s − d_c p/m_c + q̇,   f_e = −p/m_c,   while q is beyond where the body begins

    It loses no power, f_e q̇ + u_c y_c = 0, and is no contact: the force on either is the velocity of the other, so that
    at rest there is none, wherever the gripper stands, and nothing holds it back. ``CompliantBody`` is what touches.

    Args:
        geometry: the joint, and where the body begins.
        stiffness: K_c [N·m/rad].
        damping: d_c [N·m·s/rad].
        mass: m_c [kg·m²], which the thesis does not print.
    """

    def __init__(self, geometry: JointContact, *, stiffness: float, damping: float, mass: float) -> None:
        super().__init__(geometry)
        self.stiffness = positive("stiffness", stiffness)
        self.damping = positive("damping", damping)
        self.mass = positive("mass", mass)

    @property
    def state_size(self) -> int:
        """Two: displacement and momentum."""
        return 2

    def initial_state(self) -> Array:
        """Return the body at rest."""
        return np.zeros(2)

    def touch(self, x: MechanicalState, state: Array) -> Touch:
        """Return forces, rates of (s, p), energy and losses. The magnitude is f_e, which may be negative."""
        displacement, momentum = float(state[0]), float(state[1])
        gap, speed = self.geometry.gap(x), momentum / self.mass
        coupled = gap.distance <= 0.0
        pushed = float(gap.slope.dot(x.velocity)) if coupled else 0.0
        force = -speed if coupled else 0.0
        return Touch(
            gap.slope * force,
            np.array([speed, pushed - self.stiffness * displacement - self.damping * speed]),
            force,
            0.5 * momentum * speed + 0.5 * self.stiffness * displacement**2,
            self.damping * speed**2,
        )

    def fastest_rate(self, x: MechanicalState) -> float:
        """Return the fastest of the body's rates, and of the coupling's 1/√(m m_c) [1/s]."""
        arm = effective_mass(x, self.geometry.gap(x).slope)
        coupling = 0.0 if math.isinf(arm) else 1.0 / math.sqrt(arm * self.mass)
        return max(math.sqrt(self.stiffness / self.mass), self.damping / self.mass, coupling)
