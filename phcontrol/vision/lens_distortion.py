"""How a lens bends the image: OpenCV's model, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array
from phcontrol.exceptions import InvalidArgumentError

LENGTHS = (0, 4, 5, 8, 12, 14)
"""How many coefficients OpenCV's model may have."""
_ROUNDS = 60
_TOLERANCE = 1e-12


@dataclass(frozen=True)
class LensDistortion:
    """Brown's radial, tangential and thin-prism distortion, in OpenCV's order of coefficients.

    Of a point (x, y) = (X, Y)/Z, with r² = x² + y² and a = (1 + k₁r² + k₂r⁴ + k₃r⁶)/(1 + k₄r² + k₅r⁴ + k₆r⁶), the image
    shows (``distorted``)

        x' = a x + 2p₁xy + p₂(r² + 2x²) + s₁r² + s₂r⁴
        y' = a y + p₁(r² + 2y²) + 2p₂xy + s₃r² + s₄r⁴.

    Source: OpenCV's documentation, "Camera Calibration and 3D Reconstruction"; D. C. Brown, "Decentering distortion of
    lenses", Photogrammetric Engineering 32, 1966.

    Args:
        coefficients: (k₁, k₂, p₁, p₂[, k₃[, k₄, k₅, k₆[, s₁, s₂, s₃, s₄[, τ_x, τ_y]]]]); empty for none. A tilted
            sensor (τ other than 0) is refused.
    """

    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        values = finite_array("distortion", self.coefficients)
        if values.ndim != 1 or values.size not in LENGTHS:
            raise InvalidArgumentError(
                "distortion", f"must hold {', '.join(map(str, LENGTHS))} coefficients, but has shape {values.shape}"
            )
        if values[12:].any():
            raise InvalidArgumentError("distortion", "of a tilted sensor (τ_x, τ_y other than 0) is not supported")
        object.__setattr__(self, "coefficients", tuple(values.tolist()))
        padded = np.zeros(12)
        padded[: min(12, values.size)] = values[:12]
        object.__setattr__(self, "_padded", tuple(padded.tolist()))

    @property
    def is_none(self) -> bool:
        """Whether nothing is bent."""
        return not any(self.coefficients)

    def distorted(self, points: ArrayLike) -> Array:
        """Return where points (x, y), shape (..., 2), are shown."""
        x, y = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        return np.stack(self._map(x, y)[:2], axis=-1)

    def undistorted(self, points: ArrayLike) -> Array:
        """Return the points (x, y) that are shown at given ones, shape (..., 2), by Newton's method.

        NaN where there is none, or where the model has folded over (its Jacobian's determinant is not positive).
        """
        shown = np.asarray(points, dtype=float)
        u, v = np.moveaxis(shown, -1, 0)
        if self.is_none:
            return np.array(shown)
        x, y = u.copy(), v.copy()
        with np.errstate(all="ignore"):
            for _ in range(_ROUNDS):
                xd, yd, (a, b, c, d) = self._map(x, y)
                ex, ey, determinant = xd - u, yd - v, a * d - b * c
                step = np.stack([(d * ex - b * ey) / determinant, (a * ey - c * ex) / determinant])
                step *= np.minimum(1.0, 0.3 / np.maximum(np.hypot(*step), 1e-300))  # not over a fold
                x, y = x - step[0], y - step[1]
                if not np.abs(step).max(initial=0.0) > 0.1 * _TOLERANCE:
                    break
            xd, yd, (a, b, c, d) = self._map(x, y)
            wrong = ~((np.hypot(xd - u, yd - v) <= _TOLERANCE * (1.0 + np.hypot(u, v))) & (a * d - b * c > 0.0))
        found: Array = np.stack([x, y], axis=-1)
        found[wrong] = np.nan
        return found

    def jacobian_determinant(self, points: ArrayLike) -> Array:
        """Return how much larger a small area about (x, y) is shown than it is, shape (...)."""
        x, y = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        a, b, c, d = self._map(x, y)[2]
        determinant: Array = a * d - b * c
        return determinant

    def _map(self, x: Array, y: Array) -> tuple[Array, Array, tuple[Array, Array, Array, Array]]:
        """Return x', y', and ∂x'/∂x, ∂x'/∂y, ∂y'/∂x, ∂y'/∂y."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self.__dict__["_padded"]
        r2 = x * x + y * y
        above, below = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        ratio = above / below
        # by r²
        slope = (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2) - ratio * (k4 + r2 * (2.0 * k5 + 3.0 * k6 * r2))) / below
        prism_x, prism_y = s1 + 2.0 * s2 * r2, s3 + 2.0 * s4 * r2
        shown_x = ratio * x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + s2 * r2)
        shown_y = ratio * y + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + s4 * r2)
        return (
            shown_x,
            shown_y,
            (
                ratio + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * x * prism_x,
                2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * y * prism_x,
                2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * x * prism_y,
                ratio + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + 2.0 * y * prism_y,
            ),
        )
