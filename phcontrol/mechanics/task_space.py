"""How the joints move a frame, and what motions they have left beside."""

from __future__ import annotations

import math

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._smooth import smooth, vanishes
from phcontrol._validation import Array
from phcontrol.mechanics import kernels
from phcontrol.mechanics.singular_damping import SINGULAR_REGION, frame_damping


class TaskSpace:
    """The task space of a frame at one posture, weighted by the inertia of the arm (O. Khatib, IEEE JRA 3(1), 1987).

    Made by ``MechanicalState.task_space``. With ξ = 𝒥q̇ and M = T Tᵀ the null space is that of 𝒥 in the metric M. It is
    written here in p̄ = Tᵀq̇, where projectors are symmetric.

    Args:
        jacobian: 𝒥, shape (m, n), at the frame's origin in the axes of the world.
        factor: T, shape (n, n), lower triangular.
    """

    def __init__(self, jacobian: Array, factor: Array) -> None:
        self.jacobian = jacobian
        """𝒥, shape (m, n)."""
        self._factor = factor

    @lazy
    def _products(self) -> tuple[Array, Array, Array, float]:
        return kernels.task_space(self.jacobian, self._factor, frame_damping(len(self.jacobian)).half)

    @property
    def reduced(self) -> Array:
        """W = T⁻¹𝒥ᵀ, shape (n, m): ξ = Wᵀp̄."""
        return self._products[0]

    @property
    def mobility(self) -> Array:
        """B = 𝒥M⁻¹𝒥ᵀ = WᵀW, shape (m, m): the inverse of Λ, the frame's inertia, where that exists."""
        return self._products[1]

    @property
    def square(self) -> Array:
        """𝒥𝒥ᵀ, shape (m, m)."""
        return self._products[2]

    @lazy
    def damped(self) -> tuple[float, Array] | None:
        """What ``SingularDamping.at`` says of 𝒥𝒥ᵀ: None away from singularities."""
        doubt = max(0.0, self._products[3] * SINGULAR_REGION**4 - 1.0)  # 0: σ is surely beyond
        if vanishes(doubt):
            return None
        damping = frame_damping(len(self.jacobian))
        return damping.of_modes(*kernels.modes(damping.weighed(self.square), doubt, SINGULAR_REGION**2))

    @lazy
    def regular_mobility(self) -> Array:
        """B + λ²(tr B / tr 𝒥𝒥ᵀ)W̃ with λ² of :class:`SingularDamping`: B itself away from singularities."""
        damped, square = self.damped, self.square
        if damped is None:
            return self.mobility
        weight: Array = frame_damping(len(square)).weight
        weight = damped[0] * float(np.trace(self.mobility) / np.trace(square)) * weight
        return self.mobility + weight

    def without_task(self, momentum: Array) -> Array:
        """Return P p̄ = p̄ − W B⁻¹Wᵀp̄: the part of a momentum (or of T⁻¹f) that leaves the frame alone, shape (n,).

        P is symmetric, 0 ≤ P ≤ 1. Near a singularity B⁻¹ is damped: P lets through a part of what hardly moves the
        frame there.
        """
        twist = momentum.dot(self.reduced)
        rest: Array = momentum - self.reduced.dot(self.solve_mobility(twist))
        return rest

    def without_task_force(self, force: Array) -> Array:
        """Return T P T⁻¹f = f − 𝒥ᵀB⁻¹𝒥M⁻¹f: the part of a force that does not accelerate the frame, shape (n,)."""
        return kernels.without_task(self.jacobian, self._factor, self.reduced, self.regular_mobility, force)

    def solve_mobility(self, twist: Array) -> Array:
        """Return B⁻¹ξ = Λξ, damped near singularities, of a twist or of the columns of a matrix."""
        return kernels.solve_transposed(self._mobility_factor, kernels.solve(self._mobility_factor, twist))

    @lazy
    def _mobility_factor(self) -> Array:
        return kernels.factor(self.regular_mobility)

    @lazy
    def projector(self) -> Array:
        """P = 1 − W B⁻¹Wᵀ, shape (n, n)."""
        half = kernels.solve(self._mobility_factor, self.reduced.T)
        projector: Array = np.eye(len(self.reduced)) - half.T @ half
        return projector

    @property
    def clearance(self) -> float:
        """How clear of singularities the posture is: 0 where P is damped, 1 beyond 2.51 times that distance.

        Smooth, for it is made of a bound that needs no eigenvalues: with Y the inverse of W^(−½)𝒥𝒥ᵀW^(−½) it is
        (tr Y⁴)^(−⅛) ≤ σ ≤ 1.26 (tr Y⁴)^(−⅛).
        """
        return smooth(self._products[3] ** -0.25 / SINGULAR_REGION - 1.0)

    @property
    def manipulability(self) -> float:
        """sqrt(det 𝒥𝒥ᵀ) (T. Yoshikawa, IJRR 4(2), 1985); 0 at a singularity. Metres and radians are mixed."""
        return math.sqrt(max(float(np.linalg.det(self.jacobian @ self.jacobian.T)), 0.0))

    @property
    def singularity_distance(self) -> float:
        """Smallest singular value of 𝒥 with its angular rows times 0.3 m [m/rad]; 0 at a singularity."""
        return frame_damping(len(self.square)).distance(self.square)
