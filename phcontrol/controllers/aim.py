"""What a law makes of its potential and its reference at one state."""

from __future__ import annotations

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState
from phcontrol.potentials.potential import Goal, Potential


class Aim:
    """The error state of an arm that is led: every law runs on it as it would on the arm about a goal at rest.

    With v_e = q̇ − q̇_ref, p̄_e = Tᵀv_e, and Ψ the energy of the position errors (theory section 11), a torque
    u = u_law + G⁻¹(M q̈_ref + C q̇_ref + D q̇_ref) leaves the law's own closed loop in these.

    Args:
        x: the state of the arm.
        potential: Ψ.
        goal: where Ψ is smallest, in place of its own goal; None for that.
        reference_velocity: q̇_ref, shape (n,) [rad/s]; None for a goal at rest.
        reference_acceleration: q̈_ref, likewise [rad/s²].
        missed: what q̇_ref lacks of the goal's twist near a singularity (``ResolvedMotion``); None for nothing.
    """

    def __init__(
        self,
        x: MechanicalState,
        potential: Potential,
        goal: Goal | None = None,
        reference_velocity: Array | None = None,
        reference_acceleration: Array | None = None,
        missed: Array | None = None,
    ) -> None:
        self.missed = missed
        self.x, self.potential, self.goal = x, potential, goal
        self.reference_velocity, self.reference_acceleration = reference_velocity, reference_acceleration
        self.velocity: Array = x.velocity if reference_velocity is None else x.velocity - reference_velocity
        """v_e, shape (n,) [rad/s]."""

    @lazy
    def momentum(self) -> Array:
        """p̄_e = Tᵀv_e, shape (n,)."""
        if self.reference_velocity is None:
            return self.x.transformed_momentum
        momentum: Array = self.velocity.dot(self.x.factor)
        return momentum

    @lazy
    def gradient(self) -> Array:
        """∂Ψ/∂q, shape (n,) [N·m]."""
        return self.potential.gradient(self.x, self.goal)

    @lazy
    def energy(self) -> float:
        """Ψ [J]."""
        return self.potential.energy(self.x, self.goal)

    def gradient_rate(self) -> Array:
        """Return d/dt ∂Ψ/∂q along the motion, shape (n,) [N·m/s]."""
        return self.potential.gradient_rate(self.x, self.velocity, self.goal, self.missed)

    @property
    def error(self) -> tuple[Array, Array]:
        """The coordinates that Ψ is written in, and ∂Ψ by them."""
        return (
            self.potential.coordinates(self.x, self.goal),
            self.potential.coordinate_gradient(self.x, self.goal),
        )

    @lazy
    def coordinate_map(self) -> Array:
        """A, shape (k, n): the coordinates' rates are A v_e."""
        matrix = self.potential.coordinate_map(self.x, self.goal)
        return np.eye(self.x.system.n) if matrix is None else matrix

    @lazy
    def coupling(self) -> Array:
        """A T⁻ᵀ, shape (k, n): the coordinates' rates are that times p̄_e."""
        inverse: Array = self.x.inverse_factor.T
        matrix = self.potential.coordinate_map(self.x, self.goal)
        return inverse if matrix is None else matrix @ inverse

    def momentum_shift_rate(self) -> Array | None:
        """Return −d/dt(Tᵀq̇_ref), shape (n,); None for a goal at rest."""
        if self.reference_velocity is None or self.reference_acceleration is None:
            return None
        rate: Array = self.reference_velocity.dot(self.x.factor_rate) + self.reference_acceleration.dot(self.x.factor)
        return -rate

    def shift(self, s: Array | None = None, s_rate: Array | None = None) -> tuple[Array | None, Array | None]:
        """Return the s and ṡ of ``Shaping``: those of a law on the error state, less q̇_ref and q̈_ref."""
        if self.reference_velocity is None or self.reference_acceleration is None:
            return s, s_rate
        if s is None or s_rate is None:
            return -self.reference_velocity, -self.reference_acceleration
        return s - self.reference_velocity, s_rate - self.reference_acceleration
