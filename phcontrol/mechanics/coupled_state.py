"""The state of a robot with mimic joints, in its independent coordinates."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.mechanics import derivatives
from phcontrol.mechanics.state import MechanicalState, Plant, frame_of_reference


class CoupledMechanicalState(MechanicalState):
    """A state where some joints follow others: q_model = E q + e, with E and e constant.

    The Lagrangian in q is that of the model at E q + e, so that M = EᵀM_model E, C = EᵀC_model E,
    g = Eᵀg_model and 𝒥 = 𝒥_model E exactly. Pinocchio's own mimic joints have no Coriolis matrix
    with the passivity property and no articulated-body algorithm; they are not used.
    """

    def __init__(self, system: Plant, position: Array, velocity: Array) -> None:
        super().__init__(system, position, velocity)
        assert system.coupling is not None
        self._map: Array = system.coupling.matrix
        self._joints: Array = self._map.dot(position) + system.coupling.offset

    @lazy
    def mass_matrix(self) -> Array:
        """M = EᵀM_model E, shape (n, n) [kg·m²]."""
        full = pin.crba(self.system.model, self.system.data, self._joints)
        result: Array = self._map.T @ full @ self._map
        return result

    @lazy
    def coriolis_matrix(self) -> Array:
        """C = EᵀC_model E, shape (n, n) [N·m·s/rad]."""
        velocity = self._map.dot(self.velocity)
        full = pin.computeCoriolisMatrix(self.system.model, self.system.data, self._joints, velocity)
        result: Array = self._map.T @ full @ self._map
        return result

    def _weight_gradient(self) -> Array:
        full = pin.computeGeneralizedGravity(self.system.model, self.system.data, self._joints)
        result: Array = self._map.T.dot(full)
        return result

    def _newton_euler(self, mean: Array, lag: Array, acceleration: Array) -> Array:
        system, E = self.system, self._map
        full: Array = pin.rnea(system.model, system.data, self._joints, E.dot(mean), E.dot(acceleration))
        full -= pin.nonLinearEffects(system.weightless_model, system.data, self._joints, E.dot(lag))
        result: Array = E.T.dot(full)
        return result

    def _weight_energy(self) -> float:
        return float(pin.computePotentialEnergy(self.system.model, self.system.data, self._joints))

    def acceleration(self, torque: Array, external_force: Array | None = None) -> Array:
        """Return q̈, by the factor of M, shape (n,) [rad/s²]."""
        force = self.applied_force(torque, external_force) - self.coriolis_matrix.dot(self.velocity) - self.gravity
        solution: Array = lapack.dpotrs(self.factor, force, lower=1)[0]
        return solution

    @lazy
    def mass_matrix_derivative(self) -> Array:
        """∂M/∂q, shape (n, n, n)."""
        full = derivatives.mass_matrix_derivative(self.system.model, self.system.data, self._joints)
        result: Array = np.tensordot(self._map.T, self._map.T @ full @ self._map, axes=1)
        return result

    @property
    def _model_position(self) -> Array:
        return self._joints

    @property
    def _model_velocity(self) -> Array:
        velocity: Array = self._map.dot(self.velocity)
        return velocity

    def _independent(self, jacobian: Array) -> Array:
        result: Array = jacobian @ self._map
        return result

    def frame_jacobian(self, frame: str, reference: str) -> Array:
        """Return 𝒥 = 𝒥_model E, shape (6, n)."""
        system, index = self.system, self.system.frame_id(frame)
        reference_frame = frame_of_reference(reference)
        full = pin.computeFrameJacobian(system.model, system.data, self._joints, index, reference_frame)
        result: Array = full @ self._map
        return result

    def frame_jacobian_rate(self, frame: str, reference: str) -> Array:
        """Return 𝒥̇ along q̇, shape (6, n)."""
        system, index = self.system, self.system.frame_id(frame)
        velocity = self._map.dot(self.velocity)
        full = derivatives.frame_jacobian_rate(
            system.model, system.data, self._joints, velocity, index, frame_of_reference(reference)
        )
        result: Array = full @ self._map
        return result

    def frame_jacobian_and_rate(self, frame: str, reference: str) -> tuple[Array, Array]:
        """Return 𝒥 and 𝒥̇ along q̇, shape (6, n) each."""
        return self.frame_jacobian(frame, reference), self.frame_jacobian_rate(frame, reference)

    def frame_jacobian_derivative(self, frame: str, reference: str) -> Array:
        """Return ∂𝒥/∂q, shape (n, 6, n)."""
        system, index = self.system, self.system.frame_id(frame)
        full = derivatives.frame_jacobian_derivative(
            system.model, system.data, self._joints, index, frame_of_reference(reference)
        )
        result: Array = np.tensordot(self._map.T, full @ self._map, axes=1)
        return result
