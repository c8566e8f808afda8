"""Every mechanical quantity at one position and velocity, each computed on first use and once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from phcontrol._lazy import lazy
from phcontrol._validation import Array, choice
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics import derivatives
from phcontrol.mechanics.robot import REFERENCES

if TYPE_CHECKING:
    from phcontrol.mechanics.system import MechanicalSystem

INTERCONNECTIONS = ("coriolis", "canonical")
"""The two choices of J̄₂: "coriolis" needs no tensor, "canonical" is the thesis's (2.37), errata E6."""

_dpotrf, _dpotrs, _dtrtrs, _dtrtri, _dsygst = (
    lapack.dpotrf,
    lapack.dpotrs,
    lapack.dtrtrs,
    lapack.dtrtri,
    lapack.dsygst,
)


class MechanicalState:
    """The plant at (q, q̇), in the original and in the transformed coordinates (thesis section 2.2).

    With M = T Tᵀ (T lower triangular) and p̄ = T⁻¹p = Tᵀq̇ the plant is

        q̇ = T⁻ᵀp̄,   p̄̇ = −T⁻¹∂V/∂q + (J̄₂ − D̄)p̄ + Ḡu + T⁻¹f_e,   H̄ = ½p̄ᵀp̄ + V.

    Made by ``MechanicalSystem.at``. SI units; forces are generalised [N·m]. The arrays belong to the
    state: do not write to them.
    """

    def __init__(self, system: MechanicalSystem, position: Array, velocity: Array) -> None:
        self.system = system
        self.position = position
        """q, shape (n,) [rad]."""
        self.velocity = velocity
        """q̇, shape (n,) [rad/s]."""

    def __repr__(self) -> str:
        return f"<MechanicalState of {self.system.robot.name}: q = {self.position}, q̇ = {self.velocity}>"

    # --- the original coordinates ---------------------------------------------------------------

    @lazy
    def _full_position(self) -> Array:
        return self.system.robot.full_position(self.position)

    @lazy
    def mass_matrix(self) -> Array:
        """M(q), shape (n, n), symmetric positive definite, armature included [kg·m²]."""
        system = self.system
        mass_matrix: Array = pin.crba(system.model, system.data, self._full_position)
        if system.coupling is not None:
            mass_matrix = system.coupling.matrix.T @ mass_matrix @ system.coupling.matrix
        return mass_matrix

    @lazy
    def coriolis_matrix(self) -> Array:
        """C(q, q̇) of the Christoffel symbols, shape (n, n): Ṁ = C + Cᵀ [N·m·s/rad]."""
        return self._coriolis(self.velocity)

    def _coriolis(self, velocity: Array) -> Array:
        system = self.system
        if system.coupling is None:
            coriolis: Array = pin.computeCoriolisMatrix(system.model, system.data, self.position, velocity)
            return coriolis
        matrix = system.coupling.matrix
        full = pin.computeCoriolisMatrix(system.model, system.data, self._full_position, matrix.dot(velocity))
        coriolis = matrix.T @ full @ matrix
        return coriolis

    @lazy
    def mass_matrix_rate(self) -> Array:
        """Ṁ = C + Cᵀ, shape (n, n) [kg·m²/s]."""
        coriolis = self.coriolis_matrix
        rate: Array = coriolis + coriolis.T
        return rate

    @lazy
    def gravity(self) -> Array:
        """Generalised gravity g(q), shape (n,) [N·m]: the part of ∂V/∂q due to weight."""
        system = self.system
        gravity: Array = pin.computeGeneralizedGravity(system.model, system.data, self._full_position)
        if system.coupling is not None:
            gravity = system.coupling.matrix.T.dot(gravity)
        return gravity

    @lazy
    def _spring_gradient(self) -> Array | None:
        gradients = [potential.gradient(self.position) for potential in self.system.potentials]
        return np.sum(gradients, axis=0) if gradients else None

    @lazy
    def potential_gradient(self) -> Array:
        """∂V/∂q, gravity and springs, shape (n,) [N·m]."""
        springs = self._spring_gradient
        gradient: Array = self.gravity if springs is None else self.gravity + springs
        return gradient

    @lazy
    def damping(self) -> Array | None:
        """Diagonal of D(q̇), shape (n,) [N·m·s/rad]; None without friction."""
        friction = self.system.friction
        return None if friction is None else friction.coefficients(self.velocity)

    @lazy
    def damping_matrix(self) -> Array:
        """D(q̇), shape (n, n), diagonal [N·m·s/rad]."""
        n = self.system.n
        return np.zeros((n, n)) if self.damping is None else np.diag(self.damping)

    @lazy
    def momentum(self) -> Array:
        """p = M q̇, shape (n,) [N·m·s]."""
        momentum: Array = self.mass_matrix.dot(self.velocity)
        return momentum

    @lazy
    def input_matrix(self) -> Array:
        """G, shape (n, n)."""
        matrix = self.system.input_matrix
        return np.eye(self.system.n) if matrix is None else matrix

    @lazy
    def output(self) -> Array:
        """y = Gᵀq̇, shape (n,): the plant's power port is (u, y) [rad/s]."""
        matrix = self.system.input_matrix
        output: Array = self.velocity if matrix is None else matrix.T.dot(self.velocity)
        return output

    @lazy
    def kinetic_energy(self) -> float:
        """½q̇ᵀM q̇ [J]."""
        return float(0.5 * self.velocity.dot(self.momentum))

    @lazy
    def potential_energy(self) -> float:
        """V(q): weight and springs [J]."""
        system = self.system
        weight = pin.computePotentialEnergy(system.model, system.data, self._full_position)
        return float(weight + sum(potential.energy(self.position) for potential in system.potentials))

    @property
    def energy(self) -> float:
        """H = ½q̇ᵀM q̇ + V(q) [J]."""
        return self.kinetic_energy + self.potential_energy

    def acceleration(self, torque: Array, external_force: Array | None = None) -> Array:
        """Return q̈ under a torque u and an external force f_e, shape (n,) [rad/s²].

        By the articulated-body algorithm; with mimic joints, which it does not know, by M's factor.
        """
        system = self.system
        force = self.applied_force(torque, external_force)
        if system.coupling is None:
            acceleration: Array = pin.aba(system.model, system.data, self.position, self.velocity, force)
            return acceleration
        force = force - self.coriolis_matrix.dot(self.velocity) - self.gravity
        solution: Array = _dpotrs(self.factor, force, lower=1)[0]
        return solution

    def applied_force(self, torque: Array, external_force: Array | None = None) -> Array:
        """Return G u + f_e − D q̇ − ∂V_springs/∂q: every joint force but weight and inertia [N·m]."""
        system = self.system
        force: Array = torque if system.input_matrix is None else system.input_matrix.dot(torque)
        if external_force is not None:
            force = force + external_force
        if self.damping is not None:
            force = force - self.damping * self.velocity
        if self._spring_gradient is not None:
            force = force - self._spring_gradient
        return force

    def momentum_rate(self, torque: Array, external_force: Array | None = None) -> Array:
        """Return ṗ = Cᵀq̇ − ∂V/∂q − D q̇ + G u + f_e, shape (n,) [N·m]."""
        inertial: Array = self.coriolis_matrix.T.dot(self.velocity) - self.gravity
        return inertial + self.applied_force(torque, external_force)

    def position_error(self, target: Array) -> Array:
        """Return q ⊖ target, shape (n,) [rad]; in continuous joints wrapped to (−π, π]."""
        error: Array = self.position - target
        if self.system.has_continuous_joints:
            wrapped = -np.remainder(np.pi - error, 2.0 * np.pi) + np.pi
            error = np.where(self.system.robot.continuous, wrapped, error)
        return error

    # --- the transformed coordinates (thesis 2.31 to 2.41) --------------------------------------

    @lazy
    def factor(self) -> Array:
        """T(q), shape (n, n), lower triangular with positive diagonal: M = T Tᵀ (2.33)."""
        factor, info = _dpotrf(self.mass_matrix.T, lower=1, clean=1)
        if info:
            raise InvalidArgumentError("position", f"the mass matrix is not positive definite at {self.position}")
        result: Array = factor
        return result

    def solve_factor(self, force: Array) -> Array:
        """Return T⁻¹f for a vector or the columns of a matrix."""
        result: Array = _dtrtrs(self.factor, force, lower=1)[0]
        return result

    def solve_factor_transposed(self, momentum: Array) -> Array:
        """Return T⁻ᵀp̄ for a vector or the columns of a matrix."""
        result: Array = _dtrtrs(self.factor, momentum, lower=1, trans=1)[0]
        return result

    @lazy
    def transformed_momentum(self) -> Array:
        """p̄ = T⁻¹p = Tᵀq̇, shape (n,) (2.31)."""
        momentum: Array = self.velocity.dot(self.factor)
        return momentum

    @lazy
    def _relative_factor_rate(self) -> Array:
        """T⁻¹Ṫ = Φ(T⁻¹Ṁ T⁻ᵀ), lower triangular."""
        reduced = _dsygst(self.mass_matrix_rate.T, self.factor, lower=1)[0]  # fills the lower triangle
        rate: Array = reduced * self.system.lower_half_mask
        return rate

    @lazy
    def factor_rate(self) -> Array:
        """Ṫ = T Φ(T⁻¹Ṁ T⁻ᵀ), shape (n, n), lower triangular."""
        rate: Array = self.factor @ self._relative_factor_rate
        return rate

    @lazy
    def transformed_damping(self) -> Array:
        """D̄ = T⁻¹D T⁻ᵀ, shape (n, n) (2.39)."""
        return self.solve_factor(self.solve_factor(self.damping_matrix).T)

    @lazy
    def transformed_input(self) -> Array:
        """Ḡ = T⁻¹G, shape (n, n) (2.40)."""
        return self.solve_factor(self.input_matrix)

    @lazy
    def motion_force(self) -> Array:
        """(J̄₂ − D̄)p̄, shape (n,): what motion alone adds to p̄̇. Both choices of J̄₂ agree on p̄."""
        forces = self.coriolis_matrix.dot(self.velocity)
        if self.damping is not None:
            forces = forces + self.damping * self.velocity
        result: Array = self.transformed_momentum.dot(self._relative_factor_rate) - self.solve_factor(forces)
        return result

    @lazy
    def coriolis_interconnection(self) -> Array:
        """J̄₂ = ṪᵀT⁻ᵀ − T⁻¹C T⁻ᵀ, shape (n, n), skew because Ṁ = C + Cᵀ."""
        coriolis = self.solve_factor(self.solve_factor(self.coriolis_matrix).T).T
        result: Array = self._relative_factor_rate.T - coriolis
        return result

    @lazy
    def canonical_interconnection(self) -> Array:
        """J̄₂ = P T⁻ᵀ − T⁻¹Pᵀ, shape (n, n), with P = ∂(T⁻¹p)/∂q at constant p: (2.37), errata E6."""
        turned = self.solve_factor(self.momentum_derivative.T)
        result: Array = turned.T - turned
        return result

    @lazy
    def momentum_derivative(self) -> Array:
        """P = ∂(T⁻¹p)/∂q at constant p, shape (n, n): column k is −T⁻¹(∂T/∂q_k)p̄ = −Φ(T⁻¹(∂M/∂q_k)T⁻ᵀ)p̄."""
        inverse = _dtrtri(self.factor, lower=1)[0]
        reduced = inverse @ self.mass_matrix_derivative @ inverse.T
        reduced *= self.system.lower_half_mask
        result: Array = -reduced.dot(self.transformed_momentum).T
        return result

    def interconnection(self, form: str) -> Array:
        """Return J̄₂ in the form "coriolis" or "canonical", shape (n, n)."""
        if form == "coriolis":
            return self.coriolis_interconnection
        choice("interconnection", form, INTERCONNECTIONS)
        return self.canonical_interconnection

    # --- derivatives with respect to q ----------------------------------------------------------

    @lazy
    def mass_matrix_derivative(self) -> Array:
        """∂M/∂q, shape (n, n, n): [k] is ∂M/∂q_k."""
        system = self.system
        tensor = derivatives.mass_matrix_derivative(system.model, system.data, self._full_position)
        if system.coupling is not None:
            matrix = system.coupling.matrix
            tensor = np.tensordot(matrix.T, matrix.T @ tensor @ matrix, axes=1)
        return tensor

    @lazy
    def factor_derivative(self) -> Array:
        """∂T/∂q, shape (n, n, n): [k] is ∂T/∂q_k, lower triangular."""
        return derivatives.factor_derivative(self.factor, self.mass_matrix_derivative)

    # --- frames -----------------------------------------------------------------------------------

    def placement(self, frame: str) -> pin.SE3:
        """Return the pose of a frame in the world."""
        system, index = self.system, self.system.frame_id(frame)
        pin.forwardKinematics(system.model, system.data, self._full_position)
        return pin.updateFramePlacement(system.model, system.data, index).copy()

    def frame_jacobian(self, frame: str, reference: str) -> Array:
        """Return 𝒥(q), shape (6, n): the twist (linear, angular) of a frame is 𝒥 q̇.

        ``reference`` is "local" (the frame's own axes), "local_world_aligned" (its origin, the
        world's axes) or "world".
        """
        system = self.system
        jacobian: Array = pin.computeFrameJacobian(
            system.model, system.data, self._full_position, system.frame_id(frame), _reference(reference)
        )
        return jacobian if system.coupling is None else jacobian @ system.coupling.matrix

    def frame_jacobian_rate(self, frame: str, reference: str) -> Array:
        """Return 𝒥̇ along q̇, shape (6, n), in the same frames of reference as ``frame_jacobian``."""
        system, index = self.system, self.system.frame_id(frame)
        matrix = None if system.coupling is None else system.coupling.matrix
        velocity = self.velocity if matrix is None else matrix.dot(self.velocity)
        pin.computeJointJacobiansTimeVariation(system.model, system.data, self._full_position, velocity)
        pin.updateFramePlacement(system.model, system.data, index)
        rate: Array = pin.getFrameJacobianTimeVariation(system.model, system.data, index, _reference(reference))
        return rate if matrix is None else rate @ matrix

    def frame_jacobian_derivative(self, frame: str, reference: str) -> Array:
        """Return ∂𝒥/∂q, shape (n, 6, n): [k] is ∂𝒥/∂q_k."""
        system = self.system
        tensor = derivatives.frame_jacobian_derivative(
            system.model, system.data, self._full_position, system.frame_id(frame), _reference(reference)
        )
        if system.coupling is not None:
            matrix = system.coupling.matrix
            tensor = np.tensordot(matrix.T, tensor @ matrix, axes=1)
        return tensor


def _reference(name: str) -> pin.ReferenceFrame:
    choice("frame of reference", name, REFERENCES)
    return REFERENCES[name]
