"""Visual servoing with a port-Hamiltonian closed loop (Theorem 5.2.3)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from phcontrol._validation import Array, gain, matrix
from phcontrol.controllers.controller import Target
from phcontrol.controllers.singular_damping import SingularDamping
from phcontrol.controllers.visual_servo import OBJECT_LENGTH, View, VisualServo
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.derivatives import (
    right_inverse,
    right_inverse_derivative,
    transformed_velocity_derivative,
)
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.vision.interaction import (
    interaction_matrix,
    interaction_matrix_derivative,
    interaction_matrix_rate,
)
from phcontrol.vision.pinhole_camera import PinholeCamera

_dgetrf, _dgetrs = lapack.dgetrf, lapack.dgetrs
SINGULAR_LEVER = 0.05
"""The default region of damping is where a feature moves less than the image's length does with a lever of this [m]."""
DAMPING_SHARE = 0.6
"""λ₀/ε by default."""


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
    """

    name = "hamiltonian_servo"

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        goal: ArrayLike,
        rate: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        posture: ArrayLike | None = None,
        posture_gain: float = 0.0,
        singular_damping: float | None = None,
        singular_region: float | None = None,
        camera: PinholeCamera | None = None,
        frame: str | None = None,
        object_length: float = OBJECT_LENGTH,
        lost: str = "error",
        interconnection: str = "coriolis",
    ) -> None:
        super().__init__(
            system,
            goal=goal,
            damping=damping,
            posture=posture,
            posture_gain=posture_gain,
            camera=camera,
            frame=frame,
            object_length=object_length,
            lost=lost,
            interconnection=interconnection,
        )
        self.rate = matrix("rate", rate, 3)
        self.stiffness = gain("stiffness", stiffness, 3)
        product = self.stiffness @ self.rate
        smallest = float(np.linalg.eigvalsh(product + product.T)[0])
        if smallest <= 0.0:
            raise InvalidArgumentError(
                "rate", f"KΛ + ΛᵀK must be positive definite, but its smallest eigenvalue is {smallest:g}"
            )
        self._convergence = np.linalg.solve(self.stiffness, self.rate.T).T  # Γ = ΛK⁻¹
        if singular_region is None:
            singular_region = SINGULAR_LEVER * self.goal[2] ** 2 / (self._focal_length * self.object_length)
        self.singular_damping = SingularDamping(
            DAMPING_SHARE * singular_region if singular_damping is None else singular_damping,
            singular_region,
            self._convergence / np.linalg.norm(self._convergence, 2),
        )

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return Λ = 2/s, K = 100, C = 5/s, and k_n = 2/s for arms with more than three joints."""
        return super().default_gains(system, goal) | {"rate": 2.0, "stiffness": 100.0}

    # --- s and ṡ ----------------------------------------------------------------------------------------

    def servo_motion(self, x: MechanicalState, features: Array) -> tuple[Array, Array, Array]:
        """Return s, ṡ and the effort −Δ̄ᵀKτ̄."""
        if self._canonical:
            s, s_rate, view = self._motion_by_gradients(x, features)
        else:
            s, s_rate, view = self._motion_along_flow(x, features)
        return s, s_rate, -self.stiffness.dot(view.error).dot(view.image_jacobian)

    def _motion_along_flow(self, x: MechanicalState, features: Array) -> tuple[Array, Array, View]:
        """Return s and ṡ from directional derivatives along q̇ alone."""
        f, length = self._focal_length, self.object_length
        jacobian, jacobian_rate = x.frame_jacobian_and_rate(self.frame, "local")
        delta = interaction_matrix(features, f, length)
        B = delta.dot(jacobian)
        error, features_rate = features - self.goal, B.dot(x.velocity)
        B_rate = interaction_matrix_rate(features, features_rate, f, length).dot(jacobian)
        B_rate += delta.dot(jacobian_rate)
        square, half = B.dot(B.T), B_rate.dot(B.T)
        square_rate = half + half.T
        wish, wish_rate = self.rate.dot(error), self.rate.dot(features_rate)
        damped = self.singular_damping.at(square)
        if damped is not None:
            s, s_rate = self._damped_motion(x, B, B_rate, square, square_rate, wish, wish_rate, damped)
        elif self._holds_posture:
            # Bᵀ S⁻¹w + (1 − BᵀS⁻¹B)z = BᵀS⁻¹(w − B z) + z
            z, z_rate = self._posture_pull(x)
            wish -= B.dot(z)
            wish_rate -= B_rate.dot(z) + B.dot(z_rate)
            s, s_rate = _right_inverse_motion(B, B_rate, square, square_rate, wish, wish_rate)
            s += z
            s_rate += z_rate
        else:
            s, s_rate = _right_inverse_motion(B, B_rate, square, square_rate, wish, wish_rate)
        return s, s_rate, View(error, B)

    def _damped_motion(
        self,
        x: MechanicalState,
        B: Array,
        B_rate: Array,
        square: Array,
        square_rate: Array,
        wish: Array,
        wish_rate: Array,
        damped: tuple[float, Array],
    ) -> tuple[Array, Array]:
        """Return s and ṡ where λ² > 0."""
        level, slope = damped
        level_rate = float(np.vdot(slope, square_rate))
        weight = self.singular_damping.weight
        s, s_rate = _right_inverse_motion(
            B, B_rate, square + level * weight, square_rate + level_rate * weight, wish, wish_rate
        )
        fade, fade_rate = self._fade(level), self._fade(level_rate) - 1.0
        if self._holds_posture and fade > _FADED:
            z, z_rate = self._posture_pull(x)
            away = _right_inverse_motion(B, B_rate, square, square_rate, B.dot(z), B_rate.dot(z) + B.dot(z_rate))
            inner, inner_rate = z - away[0], z_rate - away[1]
            s += fade * inner
            s_rate += fade * inner_rate + fade_rate * inner
        return s, s_rate

    def _fade(self, level: float) -> float:
        """Return 1 − λ²/λ₀²."""
        return 1.0 - level / self.singular_damping.level**2

    def _posture_pull(self, x: MechanicalState) -> tuple[Array, Array]:
        """Return k_n(q − q_r) and k_n q̇, shape (n,) each."""
        return self.posture_gain * x.position_error(self.posture), self.posture_gain * x.velocity

    def servo_velocity(self, x: MechanicalState, features: Array) -> Array:
        """Return s(q, τ), shape (n,) [rad/s]."""
        error, B = self.view(x, features)
        damped = self.singular_damping.at(B @ B.T)
        s: Array = right_inverse(B, self._regularisation(damped)) @ (self.rate @ error)
        fade = 1.0 if damped is None else self._fade(damped[0])
        if self._holds_posture and fade > _FADED:
            z = self._posture_pull(x)[0]
            s = s + fade * (z - right_inverse(B) @ (B @ z))
        return s

    def _regularisation(self, damped: tuple[float, Array] | None) -> Array | None:
        return None if damped is None else damped[0] * self.singular_damping.weight

    # --- the full derivatives ---------------------------------------------------------------------------

    def momentum_derivatives(self, x: MechanicalState, features: Array) -> tuple[Array, Array]:
        """Return ∂θ/∂q, shape (n, n), and ∂θ/∂τ, shape (n, 3), of θ = Tᵀs(q, τ), as in (5.28) and (5.29).

        Column k is the derivative with respect to q_k, or to the k-th feature.
        """
        by_position, by_features, s, _ = self._velocity_derivatives(x, features)
        return (
            transformed_velocity_derivative(x.factor, x.factor_derivative, s, by_position),
            x.factor.T @ by_features,
        )

    def _velocity_derivatives(self, x: MechanicalState, features: Array) -> tuple[Array, Array, Array, View]:
        """Return ∂s/∂q, ∂s/∂τ, s, and the view."""
        f, length, n = self._focal_length, self.object_length, x.system.n
        jacobian = x.frame_jacobian(self.frame, "local")
        delta = interaction_matrix(features, f, length)
        view = View(features - self.goal, delta @ jacobian)
        B = view.image_jacobian
        dB = np.concatenate(  # stacked: n joints, then three features
            [
                delta @ x.frame_jacobian_derivative(self.frame, "local"),
                interaction_matrix_derivative(features, f, length) @ jacobian,
            ]
        )
        damped = self.singular_damping.at(B @ B.T)
        wish, z = self.rate @ view.error, self._posture_pull(x)[0]
        if damped is not None:
            s, ds = self._damped_derivatives(B, dB, wish, z, damped)
        else:
            # Bᵀ S⁻¹w + (1 − BᵀS⁻¹B)z = B†(w − B z) + z
            inverse, d_inverse = right_inverse(B), right_inverse_derivative(B, dB)
            if self._holds_posture:
                wish = wish - B @ z
            s, ds = inverse @ wish, d_inverse @ wish
            ds[n:] += (inverse @ self.rate).T
            if self._holds_posture:
                s += z
                ds -= (dB @ z) @ inverse.T
                ds[:n] += self.posture_gain * (np.eye(n) - inverse @ B)
        return ds[:n].T, ds[n:].T, s, view

    def _damped_derivatives(
        self, B: Array, dB: Array, wish: Array, z: Array, damped: tuple[float, Array]
    ) -> tuple[Array, Array]:
        """Return s and its derivatives by joints and features, shape (n + 3, n), where λ² > 0."""
        n, (level, slope) = B.shape[1], damped
        weight = self.singular_damping.weight
        d_level = 2.0 * np.tensordot(dB @ B.T, slope)  # d(λ²) = tr(slope d(BBᵀ))
        Q, dQ = level * weight, d_level[:, None, None] * weight
        inverse = right_inverse(B, Q)
        s: Array = inverse @ wish
        ds: Array = right_inverse_derivative(B, dB, Q, dQ) @ wish
        ds[n:] += (inverse @ self.rate).T
        fade = self._fade(level)
        if self._holds_posture and fade > _FADED:
            plain, along = right_inverse(B), B @ z
            inner = z - plain @ along
            d_inner = -(right_inverse_derivative(B, dB) @ along + (dB @ z) @ plain.T)
            d_inner[:n] += self.posture_gain * (np.eye(n) - plain @ B)
            s += fade * inner
            ds += fade * d_inner - d_level[:, None] / self.singular_damping.level**2 * inner
        return s, ds

    def _motion_by_gradients(self, x: MechanicalState, features: Array) -> tuple[Array, Array, View]:
        """Return s and ṡ = T⁻ᵀ(θ̇ − Ṫᵀs) with θ̇ = (∂θ/∂q)q̇ + (∂θ/∂τ)τ̇."""
        by_position, by_features, s, view = self._velocity_derivatives(x, features)
        theta_by_position = transformed_velocity_derivative(x.factor, x.factor_derivative, s, by_position)
        theta_by_features = x.factor.T @ by_features
        theta_rate = theta_by_position @ x.velocity + theta_by_features @ (view.image_jacobian @ x.velocity)
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

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return (p̂, τ̄); p̄ when no object is seen."""
        momentum, features = self.adapted_momentum(x, measured), self.seen(measured)
        return momentum if features is None else np.concatenate([momentum, features - self.goal])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (p̂, τ̄); that of the braked arm on p̄ when no object is seen."""
        upper, features = super().target(t, x, state, measured), self.seen(measured)
        if features is None:
            return upper
        n = x.system.n
        error, B = self.view(x, features)
        square = B @ B.T
        Q = self._regularisation(self.singular_damping.at(square))
        last = (
            self._convergence if Q is None else square @ np.linalg.solve(square + Q, self._convergence)
        )  # N = Δ̄Δ̄ᵀ(Δ̄Δ̄ᵀ + λ²W)⁻¹Γ
        coupling = x.solve_factor(B.T)  # T⁻¹Δ̄ᵀ
        zero = np.zeros((n, 3))
        return Target(
            coordinates=np.concatenate([upper.coordinates, error]),
            interconnection=np.block([[upper.interconnection, -coupling], [coupling.T, -0.5 * (last - last.T)]]),
            dissipation=np.block([[upper.dissipation, zero], [zero.T, 0.5 * (last + last.T)]]),
            gradient=np.concatenate([upper.gradient, self.stiffness @ error]),
            port=np.vstack([upper.port, zero.T]),
        )


_FADED = 1e-10
"""Where 1 − λ²/λ₀² is below this, the posture term is left out: N is no longer defined at the singular set."""


def _right_inverse_motion(
    B: Array, B_rate: Array, square: Array, square_rate: Array, wish: Array, wish_rate: Array
) -> tuple[Array, Array]:
    """Return s = Bᵀ A⁻¹w and its rate, with A = ``square`` (BBᵀ, damped or not)."""
    lu, pivots, info = _dgetrf(square)
    if info:
        nothing = np.full(B.shape[1], np.nan)  # singular and undamped: the torque is refused as not finite
        return nothing, nothing
    y = _dgetrs(lu, pivots, wish)[0]
    y_rate = _dgetrs(lu, pivots, wish_rate - square_rate.dot(y))[0]
    return y.dot(B), y.dot(B_rate) + y_rate.dot(B)
