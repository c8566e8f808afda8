"""Visual servoing by reduction (Theorem 5.2.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, matrix
from phcontrol.controllers.parameters import Parameter
from phcontrol.controllers.visual_servo import VisualServo
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.derivatives import right_inverse
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured


class ReductionServo(VisualServo):
    """Bring image features to τ_d with a constant gain K_τ (Theorem 5.2.2).

        p̂ = p̄ + Tᵀs,   s = K_τ τ̄ + N₀ k_n(q − q_r),   τ̄ = τ − τ_d
        u = G⁻¹[∂V/∂q − M ṡ − (C + D)s − T K p̂]      (coriolis; C is the Coriolis matrix)

    Thesis (5.21), corrected: gravity is compensated (errata E18), Δ as in errata E16 and E17. The closed loop is

        p̂̇ = (J̄₂ − D̄ − K)p̂ + T⁻¹f_e,   H_d = ½|p̂|²,

    and on p̂ = 0 the features obey τ̄̇ = −Δ̄K_τ τ̄ (5.20) (k_n = 0): they reach τ_d only if Δ̄K_τ is positive stable
    along the way. ``conditions`` and the certificate say whether it is.

    N₀ = 1 − Δ̄*†Δ̄* is the projector of the goal, so that the posture term does not move the features there.

    Args:
        system: the model of the arm.
        goal: τ_d = (μ, ν, l) [m].
        feature_gain: K_τ, shape (n, 3), or a scalar or vector (a diagonal) for an arm of three joints
            [rad/s/m]; None for Δ̄(goal)†Λ, which is positive stable at the goal.
        rate: Λ, scalar, vector or (3, 3) matrix [1/s]; of the default K_τ.
        damping: K, scalar, vector or matrix, positive definite, in the transformed coordinates [1/s].
        posture: q_r [rad], where Δ̄(goal) is taken and what the posture term holds; by default the robot's home.
        posture_gain: k_n [1/s], for arms with more than three joints.
        camera: by default one of f = 10 mm without bounds, at the robot's camera frame.
        frame: the camera's frame, in place of the one that ``camera`` names.
        object_length: L [m].
        lost: "error" or "hold", see :class:`VisualServo`.
        interconnection: which J̄₂ the target is written with.

    Example:
        >>> from phcontrol import MechanicalSystem, ObservedObject, PinholeCamera, ReductionServo, load_robot
        >>> from phcontrol import simulate
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> camera = PinholeCamera()
        >>> thing = ObservedObject.seen_as(camera, [0.001, 0.001, 0.0022], system.at(system.robot.home))
        >>> servo = ReductionServo.tuned(system, [0.0, 0.0, 0.002], camera=camera)
        >>> log = simulate(system, servo, duration=1.0, dt=4e-3, scene=thing)
        >>> error = abs(log.features - servo.goal).max(axis=1)
        >>> bool(error[-1] < error[0])
        True
    """

    name = "reduction_servo"

    feature_gain: Parameter[ArrayLike | None, Array] = Parameter(
        "K_τ", "rad/s/m", default=None, check=lambda name, value, system: _feature_gain(value, system.n)
    )
    rate: Parameter[ArrayLike, Array] = Parameter(
        "Λ", "1/s", default=1.0, check=lambda name, value, system: matrix(name, value, 3)
    )

    def prepare(self) -> None:
        """Compute K_τ and the projector at the goal."""
        super().prepare()
        at_goal = self.view(self.system.at(self.posture), self.goal).image_jacobian
        inverse = right_inverse(at_goal)
        if self.feature_gain is None:
            self.feature_gain = inverse @ self.rate
        self._posture_matrix = self.posture_gain * (np.eye(self.system.n) - inverse @ at_goal)

    @property
    def lacks_minimum(self) -> str:
        """H_d = ½|p̂|² knows no features."""
        return "conditions: on p̂ = 0 the features converge where Δ̄K_τ is positive stable"

    def servo_motion(self, x: MechanicalState, features: Array) -> tuple[Array, Array, Array]:
        """Return s, ṡ = K_τΔ̄q̇ + N₀ k_n q̇, and no effort of its own."""
        error, image_jacobian = self.view(x, features)
        s_rate: Array = self.feature_gain.dot(image_jacobian.dot(x.velocity))
        if self._holds_posture:
            s_rate += self._posture_matrix.dot(x.velocity)
        return self._velocity(x, error), s_rate, np.zeros(self.system.n)

    def servo_velocity(self, x: MechanicalState, features: Array) -> Array:
        """Return s = K_τ τ̄ + N₀ k_n(q − q_r), shape (n,) [rad/s]."""
        return self._velocity(x, features - self.goal)

    def _velocity(self, x: MechanicalState, error: Array) -> Array:
        s: Array = self.feature_gain.dot(error)
        if self._holds_posture:
            s += self._posture_matrix.dot(x.position_error(self.posture))
        return s

    def conditions(self, x: MechanicalState, measured: Measured = NOTHING) -> dict[str, float]:
        """Return the smallest real part of the eigenvalues of Δ̄K_τ [1/s] at a state; the features must be seen."""
        features = self.seen(measured)
        return {} if features is None else self._stability(self.view(x, features).image_jacobian)

    def _stability(self, image_jacobian: Array) -> dict[str, float]:
        values = np.linalg.eigvals(image_jacobian @ self.feature_gain)
        return {"smallest real part of Δ̄K_τ [1/s]": float(values.real.min())}


def _feature_gain(value: ArrayLike, n: int) -> Array:
    array = finite_array("feature_gain", value)
    if array.shape == (n, 3):
        return array
    if n == 3:
        return matrix("feature_gain", array, 3)
    raise InvalidArgumentError("feature_gain", f"must have shape ({n}, 3), but has shape {array.shape}")
