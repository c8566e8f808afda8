"""What a law makes of its potential and its reference at one state."""

from __future__ import annotations

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState
from phcontrol.potentials.potential import Goal, Potential


class Aim:
    """The error state of an arm, on which every law runs: here about a goal at rest, where it is the state itself.

    Args:
        x: the state of the arm.
        potential: Ψ.
    """

    goal: Goal | None = None
    """Where Ψ is smallest, in place of its own goal."""
    reference_velocity: Array | None = None
    """q̇_ref, shape (n,) [rad/s]; None for a goal at rest."""
    reference_acceleration: Array | None = None
    """q̈_ref, likewise [rad/s²]."""
    missed: Array | None = None
    """What q̇_ref lacks of the goal's twist near a singularity (``ResolvedMotion``); None for nothing."""

    def __init__(self, x: MechanicalState, potential: Potential) -> None:
        self.x, self.potential = x, potential
        self.velocity = x.velocity
        """v_e = q̇ − q̇_ref, shape (n,) [rad/s]."""

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
        return None

    def shift(self, s: Array | None = None, s_rate: Array | None = None) -> tuple[Array | None, Array | None]:
        """Return the s and ṡ of ``Shaping``: those of a law on the error state, less q̇_ref and q̈_ref."""
        return s, s_rate


class LedAim(Aim):
    """The error state of an arm that is led along a reference (docs/theory.md, "The error state").

    With v_e = q̇ − q̇_ref, p̄_e = Tᵀv_e, and Ψ the energy of the position errors, a torque
    u = u_law + G⁻¹(M q̈_ref + C q̇_ref + D q̇_ref) leaves the law's own closed loop in these.

    Args:
        x: the state of the arm.
        potential: Ψ.
        goal: where Ψ is smallest now.
        velocity: q̇_ref, shape (n,) [rad/s].
        acceleration: q̈_ref, likewise [rad/s²].
        missed: what q̇_ref lacks of the goal's twist near a singularity; None for nothing.
        error_velocity: v_e, where it is known.
    """

    reference_velocity: Array
    reference_acceleration: Array

    def __init__(
        self,
        x: MechanicalState,
        potential: Potential,
        goal: Goal,
        velocity: Array,
        acceleration: Array,
        missed: Array | None = None,
        error_velocity: Array | None = None,
    ) -> None:
        self.x, self.potential, self.goal, self.missed = x, potential, goal, missed
        self.reference_velocity, self.reference_acceleration = velocity, acceleration
        self.velocity = x.velocity - velocity if error_velocity is None else error_velocity

    def momentum_shift_rate(self) -> Array:
        """Return −d/dt(Tᵀq̇_ref), shape (n,)."""
        velocity, acceleration = self.reference_velocity, self.reference_acceleration
        rate: Array = velocity.dot(self.x.factor_rate) + acceleration.dot(self.x.factor)
        return -rate

    def shift(self, s: Array | None = None, s_rate: Array | None = None) -> tuple[Array, Array]:
        """Return the s and ṡ of ``Shaping``: those of a law on the error state, less q̇_ref and q̈_ref."""
        velocity, acceleration = self.reference_velocity, self.reference_acceleration
        if s is None or s_rate is None:
            return -velocity, -acceleration
        return s - velocity, s_rate - acceleration
