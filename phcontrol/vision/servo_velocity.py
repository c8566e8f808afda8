"""The velocity by which the Hamiltonian servo law steers, and its derivatives: arrays in, arrays out."""

from __future__ import annotations

import numpy as np

from phcontrol._smooth import exceeds, vanishes
from phcontrol._validation import Array
from phcontrol.mechanics import kernels
from phcontrol.mechanics.derivatives import right_inverse, right_inverse_derivative
from phcontrol.mechanics.singular_damping import SingularDamping

_FADED = 1e-10
"""Where 1 − λ²/λ₀² is below this, the posture term is left out: N is no longer defined at the singular set."""


class ServoVelocity:
    """s = Bᵀ(BBᵀ + λ²W)⁻¹Λτ̄ + ψN z, for an image Jacobian B = Δ̄, an error τ̄ of the features, and a pull z.

    N = 1 − B†B is the projector on what B leaves free, ψ = 1 − λ²/λ₀². NaN where BBᵀ is singular and not damped.

    Args:
        rate: Λ, shape (3, 3) [1/s].
        damping: gives λ²W.
    """

    def __init__(self, rate: Array, damping: SingularDamping) -> None:
        self.rate, self.damping = rate, damping

    def value(self, B: Array, error: Array, pull: Array | None) -> Array:
        """Return s, shape (n,) [rad/s]; ``pull`` is z [rad/s], or None for no posture term."""
        damped = self.damping.at(B @ B.T)
        regularisation = None if damped is None else damped[0] * self.damping.weight
        s: Array = right_inverse(B, regularisation) @ (self.rate @ error)
        if pull is None:
            return s
        if damped is None:
            return s + (pull - right_inverse(B) @ (B @ pull))
        fade, defined = self._fade(damped[0])
        if not vanishes(defined):
            s = s + fade * (pull - right_inverse(B, self._undefined(defined)) @ (B @ pull))
        return s

    # --- along a motion: the fast form ------------------------------------------------------------------

    def along(
        self, B: Array, B_rate: Array, error: Array, error_rate: Array, pull: Array | None, pull_rate: Array | None
    ) -> tuple[Array, Array]:
        """Return s and ṡ along Ḃ, τ̄̇ and ż, shape (n,) each."""
        square, half = B.dot(B.T), B_rate.dot(B.T)
        square_rate = half + half.T
        desired, desired_rate = self.rate.dot(error), self.rate.dot(error_rate)
        damped = self.damping.at(square)
        if pull is None or pull_rate is None:
            if damped is not None:
                square, square_rate = self.damping.regularised(square, square_rate, damped)
            return kernels.right_inverse_motion(B, B_rate, square, square_rate, desired, desired_rate)
        along, along_rate = B.dot(pull), B_rate.dot(pull) + B.dot(pull_rate)
        if damped is None:
            # Bᵀ S⁻¹w + (1 − BᵀS⁻¹B)z = BᵀS⁻¹(w − B z) + z
            s, s_rate = kernels.right_inverse_motion(
                B, B_rate, square, square_rate, desired - along, desired_rate - along_rate
            )
            return s + pull, s_rate + pull_rate
        regularised = self.damping.regularised(square, square_rate, damped)
        s, s_rate = kernels.right_inverse_motion(B, B_rate, *regularised, desired, desired_rate)
        level, slope = damped
        fade, defined = self._fade(level)
        if not vanishes(defined):
            fade_rate = -defined * float(np.vdot(slope, square_rate)) / self.damping.level**2
            own = self._undefined(defined)
            square = square if own is None else square + own
            seen, seen_rate = kernels.right_inverse_motion(B, B_rate, square, square_rate, along, along_rate)
            free, free_rate = pull - seen, pull_rate - seen_rate
            s += fade * free
            s_rate += fade * free_rate + fade_rate * free
        return s, s_rate

    def _fade(self, level: float) -> tuple[float, float]:
        """Return ψ = 1 − λ²/λ₀², and 1, or 0 and 0 where N is not defined."""
        fade = 1.0 - level / self.damping.level**2
        defined = exceeds(fade, _FADED)
        return defined * fade, defined

    def _undefined(self, defined: float) -> Array | None:
        """Return what is added to BBᵀ where N is not defined, so that in a trace what is left out is a number."""
        left = 1.0 - defined
        return None if vanishes(left) else left * self.damping.region**2 * self.damping.weight

    # --- the full derivatives: the thesis's form --------------------------------------------------------

    def derivatives(
        self, B: Array, dB: Array, error: Array, d_error: Array, pull: Array | None, d_pull: Array | None
    ) -> tuple[Array, Array]:
        """Return s, shape (n,), and its derivatives, shape (k, n), for stacks dB (k, 3, n), dτ̄ (k, 3), dz (k, n)."""
        desired, d_desired = self.rate @ error, d_error @ self.rate.T
        damped = self.damping.at(B @ B.T)
        if damped is None:
            inverse, d_inverse = right_inverse(B), right_inverse_derivative(B, dB)
            if pull is None or d_pull is None:
                return inverse @ desired, d_inverse @ desired + d_desired @ inverse.T
            desired, d_desired = desired - B @ pull, d_desired - dB @ pull - d_pull @ B.T
            return inverse @ desired + pull, d_inverse @ desired + d_desired @ inverse.T + d_pull
        level, slope = damped
        d_level = 2.0 * np.tensordot(dB @ B.T, slope)  # d(λ²) = tr(slope d(BBᵀ))
        Q, dQ = level * self.damping.weight, d_level[:, None, None] * self.damping.weight
        inverse = right_inverse(B, Q)
        s: Array = inverse @ desired
        ds: Array = right_inverse_derivative(B, dB, Q, dQ) @ desired + d_desired @ inverse.T
        fade, defined = self._fade(level)
        if pull is not None and d_pull is not None and not vanishes(defined):
            own = self._undefined(defined)
            plain, along = right_inverse(B, own), B @ pull
            free = pull - plain @ along
            d_free = d_pull - right_inverse_derivative(B, dB, own) @ along - (dB @ pull + d_pull @ B.T) @ plain.T
            s = s + fade * free
            ds = ds + fade * d_free - defined * d_level[:, None] / self.damping.level**2 * free
        return s, ds
