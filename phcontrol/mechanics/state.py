"""Every mechanical quantity at one position and velocity, each computed on first use and once."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._lazy import lazy
from phcontrol._validation import Array, choice
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics import derivatives, kernels
from phcontrol.mechanics.friction import Friction
from phcontrol.mechanics.matrix_damping import MatrixDamping
from phcontrol.mechanics.pose import FrameKinematics
from phcontrol.mechanics.potentials import Potential
from phcontrol.mechanics.robot import REFERENCES, Coupling, Robot, wrapped
from phcontrol.mechanics.task_space import TaskSpace
from phcontrol.mechanics.varying_input import VaryingInput

INTERCONNECTIONS = ("coriolis", "canonical")
"""The two choices of J̄₂: "coriolis" needs no tensor, "canonical" is the thesis's (2.37), errata E6."""

_crba, _coriolis, _gravity, _aba = pin.crba, pin.computeCoriolisMatrix, pin.computeGeneralizedGravity, pin.aba
_rnea, _nle = pin.rnea, pin.nonLinearEffects
_factor, _solve, _solve_transposed = kernels.factor, kernels.solve, kernels.solve_transposed
_transformed_rate = kernels.transformed_rate


class Plant(Protocol):
    """What a state knows of the :class:`MechanicalSystem` that made it."""

    n: int
    robot: Robot
    friction: Friction | None
    full_damping: MatrixDamping | None
    potentials: tuple[Potential, ...]
    constant_input: Array | None
    varying_input: VaryingInput | None
    model: pin.Model
    weightless_model: pin.Model
    data: pin.Data
    coupling: Coupling | None
    has_continuous_joints: bool
    state_type: type[MechanicalState]

    def at(self, position: ArrayLike, velocity: ArrayLike | None = None) -> MechanicalState:
        """Return the state at q and q̇."""
        ...

    def motor_torque(self, force: Array) -> Array:
        """Return G⁻¹f for a constant G."""
        ...

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's index of a frame."""
        ...


class MechanicalState:
    """The plant at (q, q̇), in the original and in the transformed coordinates (thesis section 2.2).

    With M = T Tᵀ (T lower triangular) and p̄ = T⁻¹p = Tᵀq̇ the plant is

        q̇ = T⁻ᵀp̄,   p̄̇ = −T⁻¹∂V/∂q + (J̄₂ − D̄)p̄ + Ḡu + T⁻¹f_e,   H̄ = ½p̄ᵀp̄ + V.

    Made by ``MechanicalSystem.at``. SI units; forces are generalised [N·m]. The arrays belong to the
    state: do not write to them.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, load_robot
        >>> x = MechanicalSystem(load_robot("pera_shoulder")).at([0.3, 0.2], [0.1, -0.2])
        >>> np.allclose(x.kinetic_energy, 0.5 * x.velocity @ x.mass_matrix @ x.velocity)
        True
        >>> np.allclose(x.mass_matrix_rate, x.coriolis_matrix + x.coriolis_matrix.T)
        True
    """

    def __init__(self, system: Plant, position: Array, velocity: Array) -> None:
        self.system = system
        self.position = position
        """q, shape (n,) [rad]."""
        self.velocity = velocity
        """q̇, shape (n,) [rad/s]."""

    def __repr__(self) -> str:
        return f"<MechanicalState of {self.system.robot.name}: q = {self.position}, q̇ = {self.velocity}>"

    def seen_by(self, system: Plant) -> MechanicalState:
        """Return the state of another system's model at the same q and q̇: how a law, or a filter, sees this one.

        It is this very state where the system is the same, with all that was computed of it.
        """
        return self if system is self.system else system.state_type(system, self.position, self.velocity)

    # --- the original coordinates ---------------------------------------------------------------

    @lazy
    def mass_matrix(self) -> Array:
        """M(q), shape (n, n), symmetric positive definite, armature included [kg·m²]."""
        system = self.system
        mass_matrix: Array = _crba(system.model, system.data, self.position)
        return mass_matrix

    @lazy
    def coriolis_matrix(self) -> Array:
        """C(q, q̇) of the Christoffel symbols, shape (n, n): Ṁ = C + Cᵀ [N·m·s/rad]."""
        system = self.system
        coriolis: Array = _coriolis(system.model, system.data, self.position, self.velocity)
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
        return self._weight_gradient()

    def _weight_gradient(self) -> Array:
        system = self.system
        gravity: Array = _gravity(system.model, system.data, self.position)
        return gravity

    @lazy
    def potential_gradient(self) -> Array:
        """∂V/∂q, gravity and springs, shape (n,) [N·m]."""
        gradient = self._weight_gradient()
        for potential in self.system.potentials:
            gradient = gradient + potential.gradient(self.position)
        return gradient

    @lazy
    def damping(self) -> Array:
        """Diagonal of D(q̇), shape (n,) [N·m·s/rad]; zeros without friction (``system.friction is None``)."""
        friction = self.system.friction
        if self.system.full_damping is not None:
            diagonal: Array = np.diagonal(self.damping_matrix).copy()
            return diagonal
        return np.zeros(self.system.n) if friction is None else friction.coefficients(self.velocity)

    @lazy
    def friction_torque(self) -> Array:
        """D(q̇)q̇, shape (n,) [N·m]: what friction takes."""
        return self.resistance(self.velocity)

    def resistance(self, velocity: Array) -> Array:
        """Return D(q, q̇)s for a velocity s [rad/s], shape (n,) [N·m]: with a diagonal D one product an entry."""
        full = self.system.full_damping
        force: Array = self.damping * velocity if full is None else self.damping_matrix.dot(velocity)
        return force

    def injected_damping(self, damping: Array, velocity: Array) -> Array:
        """Return G C Gᵀv for an injected damping C and a velocity v [rad/s], shape (n,) [N·m]."""
        matrix = self.gears
        force: Array = damping.dot(velocity) if matrix is None else matrix.dot(damping.dot(matrix.T.dot(velocity)))
        return force

    @lazy
    def damping_matrix(self) -> Array:
        """D(q, q̇), shape (n, n), diagonal but for a :class:`MatrixDamping` [N·m·s/rad]."""
        full = self.system.full_damping
        return np.diag(self.damping) if full is None else full.matrix(self.position, self.velocity)

    @lazy
    def momentum(self) -> Array:
        """Momentum p = M q̇, shape (n,) [N·m·s]."""
        momentum: Array = self.mass_matrix.dot(self.velocity)
        return momentum

    @lazy
    def gears(self) -> Array | None:
        """G(q), shape (n, n); None for the identity, with which nothing need be multiplied."""
        system = self.system
        return system.constant_input if system.varying_input is None else system.varying_input.matrix(self.position)

    @lazy
    def input_matrix(self) -> Array:
        """G(q), shape (n, n)."""
        matrix = self.gears
        return np.eye(self.system.n) if matrix is None else matrix

    def motor_torque(self, force: Array) -> Array:
        """Return u = G(q)⁻¹f, the torque that acts on the joints as f, shape (n,) [N·m]."""
        system = self.system
        if system.varying_input is None:
            return system.motor_torque(force)
        return system.varying_input.solve(self.position, force)

    @lazy
    def output(self) -> Array:
        """Output y = Gᵀq̇, shape (n,): the plant's power port is (u, y) [rad/s]."""
        matrix = self.gears
        output: Array = self.velocity if matrix is None else matrix.T.dot(self.velocity)
        return output

    @lazy
    def kinetic_energy(self) -> float:
        """½q̇ᵀM q̇ [J]."""
        return float(0.5 * self.velocity.dot(self.momentum))

    @lazy
    def potential_energy(self) -> float:
        """V(q): weight and springs [J]."""
        return self._weight_energy() + sum(potential.energy(self.position) for potential in self.system.potentials)

    def _weight_energy(self) -> float:
        return float(pin.computePotentialEnergy(self.system.model, self.system.data, self.position))

    @property
    def energy(self) -> float:
        """H = ½q̇ᵀM q̇ + V(q) [J]."""
        return self.kinetic_energy + self.potential_energy

    def acceleration(self, torque: Array, external_force: Array | None = None) -> Array:
        """Return q̈ under a torque u and an external force f_e, shape (n,) [rad/s²]."""
        system = self.system
        force = self.applied_force(torque, external_force)
        acceleration: Array = _aba(system.model, system.data, self.position, self.velocity, force)
        return acceleration

    def applied_force(self, torque: Array, external_force: Array | None = None) -> Array:
        """Return G u + f_e − D q̇ − ∂V_springs/∂q: every joint force but weight and inertia [N·m]."""
        system = self.system
        matrix = self.gears
        force: Array = torque if matrix is None else matrix.dot(torque)
        if external_force is not None:
            force = force + external_force
        if system.friction is not None:
            force = force - self.friction_torque
        for potential in system.potentials:
            force = force - potential.gradient(self.position)
        return force

    def total_force(self, external_force: Array | None = None) -> Array:
        """Return f = −∂H/∂q − D q̇ + f_e = Cᵀq̇ − ∂V/∂q − D q̇ + f_e, shape (n,) [N·m]: ṗ but for the motors (3.52)."""
        force: Array = self.coriolis_matrix.T.dot(self.velocity) - self.potential_gradient
        if self.system.friction is not None:
            force -= self.friction_torque
        if external_force is not None:
            force += external_force
        return force

    def momentum_rate(self, torque: Array, external_force: Array | None = None) -> Array:
        """Return ṗ = f + G u, shape (n,) [N·m]."""
        matrix = self.gears
        rate: Array = self.total_force(external_force) + (torque if matrix is None else matrix.dot(torque))
        return rate

    def feedforward(self, velocity: Array, acceleration: Array) -> Array:
        """Return M a + C(q, q̇)s + D(q̇)s + ∂V/∂q for a velocity s [rad/s] and an acceleration a [rad/s²], shape (n,).

        It is what makes the arm move along with s and a [N·m]. C(q, q̇)s is bilinear and symmetric in q̇ and s, and
        h(v) = C(q, v)v, so that C(q, q̇)s = h(½(q̇ + s)) − h(½(q̇ − s)): two recursive Newton-Euler passes, no matrix.
        """
        mean = self.velocity + velocity
        mean *= 0.5
        force = self._newton_euler(mean, self.velocity - mean, acceleration)
        if self.system.friction is not None:
            force += self.resistance(velocity)
        for potential in self.system.potentials:
            force += potential.gradient(self.position)
        return force

    def _newton_euler(self, mean: Array, lag: Array, acceleration: Array) -> Array:
        """Return M a + h(mean) − h(lag) + g [N·m]."""
        system = self.system
        force: Array = _rnea(system.model, system.data, self.position, mean, acceleration)
        force -= _nle(system.weightless_model, system.data, self.position, lag)
        return force

    def position_error(self, target: Array) -> Array:
        """Return q ⊖ target, shape (n,) [rad]; in continuous joints wrapped to (−π, π]."""
        error: Array = self.position - target
        if self.system.has_continuous_joints:
            error = np.where(self.system.robot.continuous, wrapped(error), error)
        return error

    # --- the transformed coordinates (thesis 2.31 to 2.41) --------------------------------------

    @lazy
    def factor(self) -> Array:
        """T(q), shape (n, n), lower triangular with positive diagonal: M = T Tᵀ (2.33)."""
        try:
            return _factor(self.mass_matrix)
        except ArithmeticError:
            message = f"the mass matrix is not positive definite at {self.position}"
            raise InvalidArgumentError("position", message) from None

    def solve_factor(self, force: Array) -> Array:
        """Return T⁻¹f for a vector or the columns of a matrix."""
        return _solve(self.factor, force)

    def solve_factor_transposed(self, momentum: Array) -> Array:
        """Return T⁻ᵀp̄ for a vector or the columns of a matrix."""
        return _solve_transposed(self.factor, momentum)

    @lazy
    def inverse_factor(self) -> Array:
        """T⁻¹, shape (n, n), lower triangular."""
        return self.solve_factor(np.eye(self.system.n))

    @lazy
    def transformed_momentum(self) -> Array:
        """p̄ = T⁻¹p = Tᵀq̇, shape (n,) (2.31)."""
        momentum: Array = self.velocity.dot(self.factor)
        return momentum

    @lazy
    def _relative_factor_rate(self) -> Array:
        """T⁻¹Ṫ = Φ(T⁻¹Ṁ T⁻ᵀ), lower triangular."""
        return kernels.relative_factor_rate(self.factor, self.coriolis_matrix)

    @lazy
    def factor_rate(self) -> Array:
        """Ṫ = T Φ(T⁻¹Ṁ T⁻ᵀ), shape (n, n), lower triangular."""
        rate: Array = self.factor @ self._relative_factor_rate
        return rate

    @lazy
    def transformed_damping(self) -> Array:
        """D̄ = T⁻¹D T⁻ᵀ, shape (n, n) (2.39)."""
        return self.transformed(self.damping_matrix)

    @lazy
    def transformed_input(self) -> Array:
        """Ḡ = T⁻¹G, shape (n, n) (2.40)."""
        return self.solve_factor(self.input_matrix)

    def transformed(self, matrix: Array) -> Array:
        """Return T⁻¹X T⁻ᵀ of a symmetric matrix X of the joints, shape (n, n)."""
        return self.solve_factor(self.solve_factor(matrix).T)

    def transformed_injection(self, damping: Array) -> Array:
        """Return ḠCḠᵀ of an injected damping C, shape (n, n)."""
        result: Array = self.transformed_input @ damping @ self.transformed_input.T
        return result

    def transformed_rate(self, force: Array) -> Array:
        """Return T⁻¹f + (J̄₂ − D̄)p̄, shape (n,): p̄̇ when ``force`` f is all that acts beside motion [N·m].

        Both choices of J̄₂ agree on p̄, so this has no choice to make: it is
        Ṫᵀq̇ + T⁻¹(f − C q̇ − D q̇).
        """
        if self.system.friction is not None:
            force = force - self.friction_torque
        return _transformed_rate(self.factor, self.coriolis_matrix, self.velocity, force)

    def structure_rate(self, form: str, velocity: Array, force: Array | None = None) -> Array:
        """Return (J̄₂ − D̄)Tᵀs + T⁻¹f for a velocity s [rad/s], a form of J̄₂ and a force f [N·m], shape (n,)."""
        if force is None:
            force = np.zeros(self.system.n)
        if self.system.friction is not None:
            force = force - self.resistance(velocity)
        if form == "coriolis":
            return _transformed_rate(self.factor, self.coriolis_matrix, velocity, force)
        rate: Array = self.interconnection(form).dot(velocity.dot(self.factor))
        return rate + self.solve_factor(force)

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
        return kernels.momentum_derivative(self.factor, self.mass_matrix_derivative, self.transformed_momentum)

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
        return derivatives.mass_matrix_derivative(self.system.model, self.system.data, self.position)

    @lazy
    def factor_derivative(self) -> Array:
        """∂T/∂q, shape (n, n, n): [k] is ∂T/∂q_k, lower triangular."""
        return derivatives.factor_derivative(self.factor, self.mass_matrix_derivative)

    # --- frames -----------------------------------------------------------------------------------

    def placement(self, frame: str) -> pin.SE3:
        """Return the pose of a frame in the world."""
        system, index = self.system, self.system.frame_id(frame)
        pin.forwardKinematics(system.model, system.data, self._model_position)
        return pin.updateFramePlacement(system.model, system.data, index).copy()

    @property
    def _model_position(self) -> Array:
        return self.position

    def frame_kinematics(self, frame: str) -> FrameKinematics:
        """Return the pose of a frame and its Jacobian "local_world_aligned", computed on first use and once a frame."""
        found = self._frame_kinematics.get(frame)
        if found is None:
            system, index = self.system, self.system.frame_id(frame)
            pin.computeJointJacobians(system.model, system.data, self._model_position)
            found = self._frame_kinematics[frame] = self._kinematics_in_data(index)
        return found

    def frame_kinematics_rate(self, frame: str) -> Array:
        """Return 𝒥̇ along q̇ of ``frame_kinematics``, shape (6, n), computed once a frame; one pass gives both."""
        rate = self._frame_rates.get(frame)
        if rate is None:
            system, index = self.system, self.system.frame_id(frame)
            model, data = system.model, system.data
            pin.computeJointJacobiansTimeVariation(model, data, self._model_position, self._model_velocity)
            self._frame_kinematics[frame] = self._kinematics_in_data(index)
            full = pin.getFrameJacobianTimeVariation(model, data, index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            rate = self._frame_rates[frame] = self._independent(full)
        return rate

    def task_space(self, frame: str, rows: int = 6) -> TaskSpace:
        """Return how the joints move a frame, and what they leave it: made on first use and once a frame.

        Args:
            frame: name of a link or frame.
            rows: 6 for pose, 3 for position alone.
        """
        found = self._task_spaces.get((frame, rows))
        if found is None:
            jacobian = self.frame_kinematics(frame).jacobian
            found = TaskSpace(jacobian if rows == 6 else jacobian[:rows], self.factor)
            self._task_spaces[frame, rows] = found
        return found

    @lazy
    def kept(self) -> dict[object, Any]:
        """What is computed once for this state by others, by whom: a law whose methods need the same."""
        return {}

    @lazy
    def _task_spaces(self) -> dict[tuple[str, int], TaskSpace]:
        return {}

    @lazy
    def _frame_kinematics(self) -> dict[str, FrameKinematics]:
        return {}

    @lazy
    def _frame_rates(self) -> dict[str, Array]:
        return {}

    def _kinematics_in_data(self, index: int) -> FrameKinematics:
        """Return the kinematics of a frame from the joints' that were last computed in the system's workspace."""
        model, data = self.system.model, self.system.data
        pose = pin.updateFramePlacement(model, data, index)  # a copy, not a view of the workspace
        jacobian = pin.getFrameJacobian(model, data, index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        return FrameKinematics(pose.translation, pose.rotation, self._independent(jacobian))

    @property
    def _model_velocity(self) -> Array:
        return self.velocity

    def _independent(self, jacobian: Array) -> Array:
        """Return a Jacobian of all joints of the model as one of the independent joints; Pinocchio's of one is flat."""
        return jacobian.reshape(6, -1)

    def frame_jacobian(self, frame: str, reference: str) -> Array:
        """Return 𝒥(q), shape (6, n): the twist (linear, angular) of a frame is 𝒥 q̇.

        ``reference`` is "local" (the frame's own axes), "local_world_aligned" (its origin, the
        world's axes) or "world".
        """
        system, index = self.system, self.system.frame_id(frame)
        jacobian: Array = pin.computeFrameJacobian(
            system.model, system.data, self.position, index, frame_of_reference(reference)
        )
        return jacobian.reshape(6, -1)

    def frame_jacobian_rate(self, frame: str, reference: str) -> Array:
        """Return 𝒥̇ along q̇, shape (6, n), in the same frames of reference as ``frame_jacobian``."""
        system, index = self.system, self.system.frame_id(frame)
        return derivatives.frame_jacobian_rate(
            system.model, system.data, self.position, self.velocity, index, frame_of_reference(reference)
        )

    def frame_jacobian_and_rate(self, frame: str, reference: str) -> tuple[Array, Array]:
        """Return 𝒥 and 𝒥̇ along q̇ in one pass, shape (6, n) each."""
        system = self.system
        return derivatives.frame_jacobian_and_rate(
            system.model,
            system.data,
            self.position,
            self.velocity,
            system.frame_id(frame),
            frame_of_reference(reference),
        )

    def frame_jacobian_derivative(self, frame: str, reference: str) -> Array:
        """Return ∂𝒥/∂q, shape (n, 6, n): [k] is ∂𝒥/∂q_k."""
        system, index = self.system, self.system.frame_id(frame)
        return derivatives.frame_jacobian_derivative(
            system.model, system.data, self.position, index, frame_of_reference(reference)
        )


def frame_of_reference(name: str) -> pin.ReferenceFrame:
    """Return Pinocchio's frame of reference by name. Raises UnknownNameError, listing the names."""
    try:
        return REFERENCES[name]
    except (KeyError, TypeError):
        return REFERENCES[choice("frame of reference", name, REFERENCES)]
