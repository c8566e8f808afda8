"""How much the right inverse of a Jacobian is damped near its singular set."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.linalg import lapack

from phcontrol._smooth import vanishes
from phcontrol._validation import Array, number, positive
from phcontrol.mechanics import kernels

DAMPING_SHARE = 0.6
"""λ₀/ε by default."""
SINGULAR_REGION = 0.02
"""ε of a frame's Jacobian, from which on its inverse is damped [m/rad]."""
LENGTH = 0.3
"""How many metres 1 rad counts as where both are compared [m/rad]."""

_dsyev = lapack.dsyev


class SingularDamping:
    """Q = λ²W in Bᵀ(BBᵀ + Q)⁻¹, with λ² = λ₀²(1 − Πᵢ(1 − dᵢ²)), dᵢ = 1 − (σᵢ/ε)² for σᵢ < ε, else 0.

    σᵢ are the singular values of W^(−½)B. Where but the smallest is below ε this is λ₀²(1 − (σ/ε)²)². λ² is
    continuously differentiable everywhere, where two singular values cross, too: the smallest alone is not, there.
    B is the image Jacobian Δ̄ of a servo law, or the Jacobian 𝒥 of a frame.

    Args:
        level: λ₀, in the unit of W^(−½)B (of an image Jacobian [m/rad]); 0 for no damping.
        region: ε, likewise; should stay below σ at the goal, for else the goal is approached more slowly.
        weight: W, shape (m, m), its symmetric part positive definite.
    """

    def __init__(self, level: float, region: float, weight: Array) -> None:
        self.level = number("singular_damping", level, minimum=0.0)
        self.region = positive("singular_region", region)
        self.weight = weight
        symmetric = 0.5 * (weight + weight.T)
        values, vectors = np.linalg.eigh(symmetric)
        self._root: Array = (vectors / np.sqrt(values)) @ vectors.T  # W^(−½)
        self._largest = float(values.max())
        self.half: Array = (vectors * np.sqrt(values)) @ vectors.T
        """W^½."""

    def at(self, square: Array) -> tuple[float, Array] | None:
        """Return λ² and the matrix of its slope, d(λ²) = tr(slope · d(BBᵀ)), at BBᵀ; None where λ² = 0."""
        if not self.level:
            return None
        doubt = self.doubt(square)
        if vanishes(doubt):
            return None
        return self.of_modes(*kernels.modes(self.weighed(square), doubt, self.region**2))

    def weighed(self, square: Array) -> Array:
        """Return W^(−½)BBᵀW^(−½), whose eigenvalues are σᵢ²."""
        weighed: Array = self._root @ square @ self._root
        return weighed

    def of_modes(self, values: Array, vectors: Array) -> tuple[float, Array] | None:
        """Return what ``at`` does of σᵢ², in ascending order, and of their directions, the columns of a matrix."""
        depths = [max(0.0, 1.0 - max(value, 0.0) / self.region**2) for value in values]
        if vanishes(depths[0]):
            return None
        share, slope = 0.0, np.zeros_like(self.weight)
        for depth in depths:
            share += (1.0 - share) * depth**2
        for k, depth in enumerate(depths):
            if vanishes(depth):
                continue
            others = math.prod(1.0 - other**2 for other in depths[:k] + depths[k + 1 :])
            direction = self._root.dot(vectors[:, k])
            rate = -2.0 * self.level**2 * depth * others / self.region**2
            slope = slope + rate * np.multiply.outer(direction, direction)
        return self.level**2 * share, slope

    def distance(self, square: Array) -> float:
        """Return σ at BBᵀ."""
        values = _dsyev(self.weighed(square), compute_v=0)[0]
        return math.sqrt(max(float(values[0]), 0.0))

    def regularised(self, square: Array, square_rate: Array, damped: tuple[float, Array]) -> tuple[Array, Array]:
        """Return BBᵀ + λ²W and its rate, for what ``at`` returned."""
        level, slope = damped
        return square + level * self.weight, square_rate + float(np.vdot(slope, square_rate)) * self.weight

    def doubt(self, square: Array) -> float:
        """Return 0 where a bound without eigenvalues says that σ at BBᵀ is beyond ε, as mostly it does; else > 0."""
        if len(square) == 3:  # the smallest eigenvalue of a positive definite matrix is at least 4 det / trace²
            (a, b, c), (_, d, e), (_, _, f) = square.tolist()
            determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
            trace = a + d + f
            doubt: float = max(0.0, 0.25 * self.region**2 * self._largest * (trace * trace) - determinant)
            return doubt
        try:
            columns = kernels.solve(kernels.factor(square), self.half)
        except ArithmeticError:
            return 1.0
        return max(0.0, float(np.vdot(columns, columns)) * self.region**2 - 1.0)  # σ² ≥ 1 / tr(W A⁻¹), A = BBᵀ


def frame_damping(
    rows: int,
    level: float = DAMPING_SHARE * SINGULAR_REGION,
    region: float = SINGULAR_REGION,
    length: float = LENGTH,
) -> SingularDamping:
    """Return the damping of a frame's Jacobian of 3 or 6 rows, with W = diag(1, 1, 1, 1/ℓ², 1/ℓ², 1/ℓ²)."""
    return _made(rows, level, region, length)


@lru_cache
def _made(rows: int, level: float, region: float, length: float) -> SingularDamping:
    angular = positive("length", length) ** -2
    return SingularDamping(level, region, np.diag([1.0] * 3 + [angular] * (rows - 3)))
