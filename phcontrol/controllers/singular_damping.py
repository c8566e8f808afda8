"""How much the inverse of an image Jacobian is damped near its singular set."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from phcontrol._validation import Array, number, positive


class SingularDamping:
    """Q = λ²W in Δ̄ᵀ(Δ̄Δ̄ᵀ + Q)⁻¹, with λ² = λ₀²(1 − (σ/ε)²)² for σ < ε, else 0.

    σ is the smallest singular value of W^(−½)Δ̄. λ² is continuously differentiable at σ = ε.

    Args:
        level: λ₀ [m/rad]; 0 for no damping.
        region: ε [m/rad]; should stay below σ at the goal, for else the goal is approached more slowly.
        weight: W, shape (m, m), its symmetric part positive definite.
    """

    def __init__(self, level: float, region: float, weight: Array) -> None:
        self.level = number("singular_damping", level, minimum=0.0)
        self.region = positive("singular_region", region)
        self.weight = weight
        values, vectors = np.linalg.eigh(0.5 * (weight + weight.T))
        self._root: Array = (vectors / np.sqrt(values)) @ vectors.T  # W^(−½)
        self._near = 0.25 * self.region**2 * float(values.max())

    def at(self, square: Array) -> tuple[float, Array] | None:
        """Return λ² and the matrix of its slope, d(λ²) = tr(slope · d(Δ̄Δ̄ᵀ)), at Δ̄Δ̄ᵀ; None where λ² = 0."""
        if not self.level:
            return None
        # the smallest eigenvalue of a positive definite 3 × 3 matrix is at least 4 det / trace²: mostly that is enough
        (a, b, c), (_, d, e), (_, _, f) = square.tolist()
        determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
        if determinant > self._near * (a + d + f) ** 2:
            return None
        values, vectors, _ = lapack.dsyev(self._root @ square @ self._root)
        depth = 1.0 - max(float(values[0]), 0.0) / self.region**2
        if depth <= 0.0:
            return None
        direction = self._root.dot(vectors[:, 0])
        slope: Array = (-2.0 * self.level**2 * depth / self.region**2) * np.multiply.outer(direction, direction)
        return self.level**2 * depth**2, slope
