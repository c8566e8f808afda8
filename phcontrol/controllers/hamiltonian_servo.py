"""Visual servoing with a port-Hamiltonian closed loop (Theorem 5.2.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from phcontrol._validation import Array, gain, matrix
from phcontrol.controllers.parameters import NonNegative, Parameter, Positive
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.controllers.visual_servo import View, VisualServo
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.derivatives import transformed_velocity_derivative
from phcontrol.mechanics.singular_damping import DAMPING_SHARE, SingularDamping
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.vision.interaction import (
    interaction_matrix,
    interaction_matrix_derivative,
    interaction_matrix_rate,
)
from phcontrol.vision.servo_velocity import ServoVelocity

_dsyev = lapack.dsyev

SINGULAR_LEVER = 0.05
"""The default region of damping is where a feature moves less than the image's length does with a lever of this [m]."""


class HamiltonianServo(VisualServo):
    """Bring image features to τ_d with a closed loop that is port-Hamiltonian (Theorem 5.2.3).

        p̂ = p̄ + Tᵀs,   s = Δ̄ᵀ(Δ̄Δ̄ᵀ + λ²W)⁻¹Λτ̄ + ψN k_n(q − q_r),   τ̄ = τ − τ_d
        u = G⁻¹[∂V/∂q − M ṡ − (C + D)s − T C p̂ − Δ̄ᵀKτ̄]      (coriolis; in C s the Coriolis matrix)

    The closed loop on (p̂, τ̄), with H_d = ½|p̂|² + ½τ̄ᵀKτ̄ and f_e entering the first row as T⁻¹f_e, is

        [[J̄₂ − D̄ − C, −T⁻¹Δ̄ᵀ], [Δ̄T⁻ᵀ, −Δ̄Δ̄ᵀ(Δ̄Δ̄ᵀ + λ²W)⁻¹Γ]] ∇H_d,   Γ = ΛK⁻¹,  W = Γ/|Γ|,

    thesis (5.27) to (5.46) for Λ = K = 1, λ = 0, k_n = 0, corrected: errata E16, E17, E19. Far from singularities
    τ̄̇ = −Λτ̄ + Δ̄T⁻ᵀp̂.

    Near singularities λ² > 0 (:class:`SingularDamping`); the loop stays port-Hamiltonian, its last block then damps
    less. The posture term acts in the null space of Δ̄ (N = 1 − Δ̄†Δ̄), where the target does not see it; it
    fades as λ² grows (ψ = 1 − λ²/λ₀²), because N turns fast there.

    ``interconnection="coriolis"`` takes ṡ along the motion, from Δ̄̇ = Δ̇𝒥 + Δ𝒥̇; ``"canonical"`` from the full
    ∂θ/∂q and ∂θ/∂τ of ``momentum_derivatives``, as (5.28) and (5.29) do.

    Args:
        system: the model of the arm.
        goal: τ_d = (μ, ν, l) [m].
        rate: Λ, scalar, vector or (3, 3) matrix, with KΛ + ΛᵀK positive definite [1/s].
        stiffness: K, scalar, vector or matrix, positive definite [N·m/m²: weighs features in metres as energy].
        damping: C, likewise (n, n), in the transformed coordinates [1/s].
        posture: q_r [rad]; by default the robot's home.
        posture_gain: k_n [1/s], for arms with more than three joints.
        singular_damping: λ₀ [m/rad]; 0 for none, None for 0.6 ε.
        singular_region: ε [m/rad]; None for 0.05 m · l_d²/(fL): what moves the length in the image with a lever
            of 5 cm.
        camera: by default one of f = 10 mm without bounds, at the robot's camera frame.
        frame: the camera's frame, in place of the one that ``camera`` names.
        object_length: L [m].
        lost: "error" or "hold", see :class:`VisualServo`.
        interconnection: "coriolis" or "canonical".

    Example:
        >>> from phcontrol import HamiltonianServo, MechanicalSystem, ObservedObject, PinholeCamera, load_robot
        >>> from phcontrol import simulate
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> camera = PinholeCamera()
        >>> thing = ObservedObject.seen_as(camera, [0.001, 0.001, 0.0022], system.at(system.robot.home))
        >>> servo = HamiltonianServo.tuned(system, [0.0, 0.0, 0.002], camera=camera)
        >>> log = simulate(system, servo, duration=1.0, dt=4e-3, scene=thing)
        >>> error = abs(log.features - servo.goal).max(axis=1)
        >>> bool(error[-1] < 0.5 * error[0])
        True
    """

    name = "hamiltonian_servo"

    rate: Parameter[ArrayLike, Array] = Parameter(
        "Λ", "1/s", check=lambda name, value, system: matrix(name, value, 3), tuned=lambda tuning: 2.0
    )
    stiffness: Parameter[ArrayLike, Array] = Parameter(
        "K", "N·m/m²", check=lambda name, value, system: gain(name, value, 3), tuned=lambda tuning: 100.0
    )
    singular_damping: NonNegative = NonNegative("λ₀", "m/rad", default=None)
    singular_region: Positive = Positive("ε", "m/rad", default=None)

    def prepare(self) -> None:
        """Compute Γ, which must make the storage function fall, and the damping of singularities."""
        super().prepare()
        product = self.stiffness @ self.rate
        smallest = float(np.linalg.eigvalsh(product + product.T)[0])
        if smallest <= 0.0:
            raise InvalidArgumentError(
                "rate", f"KΛ + ΛᵀK must be positive definite, but its smallest eigenvalue is {smallest:g}"
            )
        self._convergence: Array = np.linalg.solve(self.stiffness, self.rate.T).T  # Γ = ΛK⁻¹
        self._convergence_root: Array | None = None  # Γ^½, of a symmetric Γ
        if np.allclose(self._convergence, self._convergence.T, rtol=1e-14, atol=0.0):
            values, vectors = np.linalg.eigh(self._convergence)
            self._convergence_root = (vectors * np.sqrt(values)) @ vectors.T
        if self.singular_region is None:
            self.singular_region = SINGULAR_LEVER * self.goal[2] ** 2 / (self._focal_length * self.object_length)
        if self.singular_damping is None:
            self.singular_damping = DAMPING_SHARE * self.singular_region
        self._convergence_size = float(np.linalg.norm(self._convergence, 2))
        weight = self._convergence / self._convergence_size
        self.damping_of_singularities = SingularDamping(self.singular_damping, self.singular_region, weight)
        self._servo_velocity = ServoVelocity(self.rate, self.damping_of_singularities)

    @property
    def lacks_minimum(self) -> str:
        """With more joints than features, H_d is the same for all postures that show the same."""
        return "a minimum over what is seen: three features do not tell all postures apart" if self.system.n > 3 else ""

    # --- s and ṡ ----------------------------------------------------------------------------------------

    def servo_motion(self, x: MechanicalState, features: Array) -> tuple[Array, Array, Array]:
        """Return s, ṡ and the effort −Δ̄ᵀKτ̄."""
        if self.interconnection == "canonical":
            s, s_rate, view = self._motion_by_gradients(x, features)
        else:
            s, s_rate, view = self._motion_along_flow(x, features)
        return s, s_rate, -self.stiffness.dot(view.error).dot(view.image_jacobian)

    def servo_velocity(self, x: MechanicalState, features: Array) -> Array:
        """Return s(q, τ), shape (n,) [rad/s]."""
        error, image_jacobian = self.view(x, features)
        return self._servo_velocity.value(image_jacobian, error, self._pull(x))

    def _motion_along_flow(self, x: MechanicalState, features: Array) -> tuple[Array, Array, View]:
        """Return s, ṡ and the view, from directional derivatives along q̇ alone."""
        f, length = self._focal_length, self.object_length
        jacobian, jacobian_rate = x.frame_jacobian_and_rate(self.frame, "local")
        delta = interaction_matrix(features, f, length)
        B = delta.dot(jacobian)
        error, features_rate = features - self.goal, B.dot(x.velocity)
        B_rate = interaction_matrix_rate(features, features_rate, f, length).dot(jacobian)
        B_rate += delta.dot(jacobian_rate)
        pull_rate = self.posture_gain * x.velocity if self._holds_posture else None
        s, s_rate = self._servo_velocity.along(B, B_rate, error, features_rate, self._pull(x), pull_rate)
        return s, s_rate, View(error, B)

    def _pull(self, x: MechanicalState) -> Array | None:
        """Return k_n(q − q_r), shape (n,) [rad/s]; None without a posture term."""
        return self.posture_gain * x.position_error(self.posture) if self._holds_posture else None

    # --- the full derivatives ---------------------------------------------------------------------------

    def momentum_derivatives(self, x: MechanicalState, features: Array) -> tuple[Array, Array]:
        """Return ∂θ/∂q, shape (n, n), and ∂θ/∂τ, shape (n, 3), of θ = Tᵀs(q, τ), as in (5.28) and (5.29).

        Column k is the derivative with respect to q_k, or to the k-th feature.
        """
        return self._gradients(x, features)[:2]

    def _gradients(self, x: MechanicalState, features: Array) -> tuple[Array, Array, Array, View]:
        """Return ∂θ/∂q, ∂θ/∂τ, s, and the view."""
        f, length, n = self._focal_length, self.object_length, x.system.n
        jacobian = x.frame_jacobian(self.frame, "local")
        delta = interaction_matrix(features, f, length)
        view = View(features - self.goal, delta @ jacobian)
        by_position = delta @ x.frame_jacobian_derivative(self.frame, "local")
        by_features = interaction_matrix_derivative(features, f, length) @ jacobian
        s, ds = self._servo_velocity.derivatives(  # stacked: by n joints, then by three features
            view.image_jacobian,
            np.concatenate([by_position, by_features]),
            view.error,
            np.eye(n + 3, 3, -n),
            self._pull(x),
            self.posture_gain * np.eye(n + 3, n) if self._holds_posture else None,
        )
        theta_by_position = transformed_velocity_derivative(x.factor, x.factor_derivative, s, ds[:n].T)
        return theta_by_position, x.factor.T @ ds[n:].T, s, view

    def _motion_by_gradients(self, x: MechanicalState, features: Array) -> tuple[Array, Array, View]:
        """Return s, ṡ = T⁻ᵀ(θ̇ − Ṫᵀs) with θ̇ = (∂θ/∂q)q̇ + (∂θ/∂τ)τ̇, and the view."""
        by_position, by_features, s, view = self._gradients(x, features)
        theta_rate = by_position @ x.velocity + by_features @ (view.image_jacobian @ x.velocity)
        return s, x.solve_factor_transposed(theta_rate - s.dot(x.factor_rate)), view

    # --- the promise ------------------------------------------------------------------------------------

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + ½τ̄ᵀKτ̄ [J]; ½|p̄|² when no object is seen."""
        energy = super().storage(t, x, state, measured)
        features = self.seen(measured)
        if features is None:
            return energy
        error = features - self.goal
        return energy + float(0.5 * error @ self.stiffness @ error)

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀv, p̂ᵀ(D̄ + C)p̂ + (Kτ̄)ᵀΔ̄Δ̄ᵀ(Δ̄Δ̄ᵀ + λ²W)⁻¹ΓKτ̄, and (D + T C Tᵀ)v."""
        port, features = super().passive_port(t, x, state, measured), self.seen(measured)
        if features is None:
            return port
        error, B = self.view(x, features)
        pull = self.stiffness.dot(error)
        return port._replace(dissipated_power=port.dissipated_power + float(pull @ self._last_block(B) @ pull))

    def _last_block(self, image_jacobian: Array) -> Array:
        """Return Δ̄Δ̄ᵀ(Δ̄Δ̄ᵀ + λ²W)⁻¹Γ, shape (3, 3).

        For a symmetric Γ it is Γ^½U diag(s/(s + λ²/|Γ|))UᵀΓ^½ with U s Uᵀ = Γ^(−½)Δ̄Δ̄ᵀΓ^(−½): semidefinite to rounding,
        however singular Δ̄ is.
        """
        square = image_jacobian @ image_jacobian.T
        damped = self.damping_of_singularities.at(square)
        if damped is None:
            return self._convergence
        result: Array
        if self._convergence_root is None:
            weighted = square + damped[0] * self.damping_of_singularities.weight
            result = square @ np.linalg.solve(weighted, self._convergence)
            return result
        root = self._convergence_root
        values, vectors, _ = _dsyev(np.linalg.solve(root, np.linalg.solve(root, square).T))
        values = np.maximum(values, 0.0)
        half = root @ vectors
        share = values / (values + damped[0] / self._convergence_size)
        result = (half * share) @ half.T
        return result

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (p̂, τ̄); that of the braked arm on p̄ when no object is seen."""
        features = self.seen(measured)
        if features is None:
            return super().target(t, x, state, measured)
        error, B = self.view(x, features)
        last, momentum = self._last_block(B), self.adapted_momentum(x, measured)
        return Target.of(
            {MOMENTUM: (momentum, momentum), "features": (error, self.stiffness @ error)},
            lambda: {
                (MOMENTUM, MOMENTUM): x.interconnection(self.interconnection),
                ("features", MOMENTUM): x.solve_factor(B.T).T,  # Δ̄T⁻ᵀ
                ("features", "features"): -0.5 * (last - last.T),
            },
            lambda: {
                (MOMENTUM, MOMENTUM): x.transformed_damping + self.damping,
                ("features", "features"): 0.5 * (last + last.T),
            },
            lambda: {MOMENTUM: x.inverse_factor},
        )
