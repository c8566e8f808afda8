"""The poles of integral action."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from phcontrol.exceptions import PHControlError
from phcontrol.poles.poles import Placed, Poles

_SECOND = 2.0  # the second real pole over the first
_RAISED, _ROUNDS = 1.25, 60  # by how much it is moved on where friction asks for it, and how often
_SHARES = 400  # of the one number that is free, looked through
_RATIO = 0.3  # s that is aimed at


class IntegralActionPoles(Poles):
    """(λ² + 2ζωλ + ω²)(λ + σ₁)(λ + σ₂) of :class:`IntegralAction`, with σ₁ = ``further``·ω and σ₂ = 2σ₁.

    Of one direction, with K_i = i, S = A K_z Aᵀ = s, K_ξ = κ, and a = A z, x = T⁻¹ξ,

        q̇ = p̃ + a − i q,   p̃̇ = −k q − d(p̃ + a) − c p̃ − x,   ȧ = −s(k q + d(p̃ + a)),   ẋ = κ p̃.

    With j = i + s d, h = k + i d and m = s h its polynomial is

        λ⁴ + (c + j + d)λ³ + (h + m + j c + κ)λ² + (c m + κ j)λ + κ m:

    four equations for five gains. j is free: of the answers in which all gains are positive the one is taken that has
    them nearest to i = ω/2, c = 2ζω, k = ω² and s = 0.3, by their logarithms. Where friction allows none, the second
    real pole is faster.
    """

    kinds: ClassVar[dict[str, str]] = {
        "stiffness": "force", "damping": "force", "force_gain": "ratio", "integral_gain": "rate",
        "integral_stiffness": "force",
    }  # fmt: skip

    def place(self, friction: float) -> Placed:
        """Return k, c, s, i and κ."""
        first = self.further * self.bandwidth
        second = _SECOND * first
        for _ in range(_ROUNDS):
            polynomial = np.polymul(np.polymul(self.pair, [1.0, first]), [1.0, second])
            gains = self._matched(polynomial, friction)
            if gains is not None:
                return Placed(gains, np.roots(polynomial).astype(complex), exact=True)
            second *= _RAISED
        raise PHControlError(f"no gains of integral action put poles at {self.bandwidth:g} rad/s against friction")

    def _matched(self, polynomial: np.ndarray, friction: float) -> dict[str, float] | None:
        """Return the gains nearest to the usual; None where there are none that are positive."""
        b3, b2, b1, b0 = (float(each) for each in polynomial[1:])
        left = b3 - friction
        best, found = math.inf, None
        for j in left * np.arange(1, _SHARES) / _SHARES if left > 0.0 else ():
            c = left - float(j)
            inside = b1**2 - 4.0 * c * j * b0
            if inside < 0.0:
                continue
            for sign in (1.0, -1.0):
                m = (b1 + sign * math.sqrt(inside)) / (2.0 * c)
                gains = _gains(float(j), c, m, b2, b0, friction) if m > 0.0 else None
                if gains is not None and (distance := self._distance(gains)) < best:
                    best, found = distance, gains
        return found

    def _distance(self, gains: dict[str, float]) -> float:
        usual = {
            "integral_gain": 0.5 * self.bandwidth, "damping": self.pair[1], "stiffness": self.bandwidth**2,
            "force_gain": _RATIO,
        }  # fmt: skip
        return sum(math.log(gains[name] / value) ** 2 for name, value in usual.items())


def _gains(j: float, c: float, m: float, b2: float, b0: float, d: float) -> dict[str, float] | None:
    kappa = b0 / m
    h = b2 - m - j * c - kappa
    if h <= 0.0:
        return None
    s = m / h
    i = j - s * d
    k = h - i * d
    if i <= 0.0 or k <= 0.0:
        return None
    return {"stiffness": k, "damping": c, "force_gain": s, "integral_gain": i, "integral_stiffness": kappa}
