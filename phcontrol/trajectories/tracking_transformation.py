"""The thesis's canonical transformation of an arm along a trajectory (chapter 6)."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.trajectories.trajectory import Reference, Trajectory


class TrackingTransformation:
    """The change of coordinates, energy, input and output that makes a moving goal the origin.

        Φ = (q − q_d, T⁻¹p − Tᵀq̇_d)                                                     (6.2)
        U = −pᵀq̇_d + ½q̇_dᵀM q̇_d − V + ½q̃ᵀK_t q̃                                           (6.6), errata E22
        Gβ = ∂U/∂q − D q̇_d + T(P_d q̇_d − Tᵀq̈_d),   P_d = ∂(T⁻¹p − Tᵀq̇_d)/∂q               (6.14), errata E22
        α = −Gᵀq̇_d                                                                      (6.10)

    It is a generalised canonical transformation (Theorem 2.2.1): the arm is port-Hamiltonian again in Φ, with
    H + U = ½|p̂|² + ½q̃ᵀK_t q̃ and J̄₂ = P_dT⁻ᵀ − T⁻¹P_dᵀ. ``check_canonical_transformation`` shows it with
    ``coordinates``, ``energy_change`` and ``input_change``.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, Sinusoid, TrackingTransformation, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> change = TrackingTransformation(system, Sinusoid([0.2, 0.1], [0.5, 0.5]), 20.0 * np.eye(2))
        >>> change.coordinates(np.zeros(2), np.zeros(2), 0.0).shape
        (4,)
    """

    def __init__(self, system: MechanicalSystem, trajectory: Trajectory, stiffness: Array) -> None:
        self.system, self.trajectory, self.stiffness = system, trajectory, stiffness

    # --- at a position, a momentum and a time ----------------------------------------------------

    def coordinates(self, position: Array, momentum: Array, t: float) -> Array:
        """Return Φ = (q − q_d, T⁻¹p − Tᵀq̇_d), shape (2n,)."""
        x, goal = self.system.at(position), self.trajectory.at(t)
        return np.concatenate([x.position_error(goal.position), x.solve_factor(momentum) - goal.velocity.dot(x.factor)])

    def energy_change(self, position: Array, momentum: Array, t: float) -> float:
        """Return U [J]."""
        x, goal = self.system.at(position), self.trajectory.at(t)
        error = x.position_error(goal.position)
        kinetic = 0.5 * goal.velocity.dot(x.mass_matrix.dot(goal.velocity)) - momentum.dot(goal.velocity)
        return float(kinetic + 0.5 * error.dot(self.stiffness.dot(error)) - x.potential_energy)

    def input_change(self, position: Array, momentum: Array, t: float) -> Array:
        """Return β, shape (n,) [N·m]."""
        x = self._state(position, momentum)
        return x.motor_torque(self.input_force(x, self.trajectory.at(t)))

    def output_change(self, position: Array, momentum: Array, t: float) -> Array:
        """Return α, shape (n,) [rad/s]."""
        x, goal = self._state(position, momentum), self.trajectory.at(t)
        change: Array = -x.input_matrix.T.dot(goal.velocity)
        return change

    def _state(self, position: Array, momentum: Array) -> MechanicalState:
        x = self.system.at(position)
        return self.system.at(position, x.solve_factor_transposed(x.solve_factor(momentum)))

    # --- at a state and a reference ---------------------------------------------------------------

    def input_force(self, x: MechanicalState, goal: Reference) -> Array:
        """Return Gβ, shape (n,) [N·m]."""
        velocity = goal.velocity
        error = x.position_error(goal.position)
        kinetic = 0.5 * x.mass_matrix_derivative.dot(velocity).dot(velocity)
        force: Array = kinetic - x.potential_gradient + self.stiffness.dot(error)
        if x.system.friction is not None:
            force -= x.resistance(velocity)
        force += x.factor.dot(self._momentum_derivative(x, velocity).dot(velocity) - goal.acceleration.dot(x.factor))
        return force

    def interconnection(self, x: MechanicalState, goal: Reference) -> Array:
        """Return J̄₂ = P_dT⁻ᵀ − T⁻¹P_dᵀ, shape (n, n), skew."""
        turned = x.solve_factor(self._momentum_derivative(x, goal.velocity).T)
        result: Array = turned.T - turned
        return result

    def _momentum_derivative(self, x: MechanicalState, velocity: Array) -> Array:
        """Return P_d = ∂(T⁻¹p − Tᵀq̇_d)/∂q at constant p, shape (n, n)."""
        desired = velocity.dot(x.factor_derivative)  # row k is (∂T/∂q_k)ᵀq̇_d
        result: Array = x.momentum_derivative - desired.T
        return result
