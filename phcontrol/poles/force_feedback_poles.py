"""The poles of force feedback."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from phcontrol.exceptions import PHControlError
from phcontrol.poles.poles import Placed, Poles

_RAISED, _ROUNDS = 1.25, 60  # by how much the real pole is moved on where friction asks for it, and how often


class ForceFeedbackPoles(Poles):
    """(λ² + 2ζωλ + ω²)(λ + σ) of :class:`ForceFeedback`, with σ = ``further``·ω.

    Of one direction, with p̂ = v − w, w = T⁻ᵀA z and S = A K_z Aᵀ = s,

        q̇ = p̂ + w,   p̂̇ = −k q − d(p̂ + w) − c p̂,   ẇ = −s(k q + d(p̂ + w)),
        λ³ + [(1 + s)d + c]λ² + [(1 + s)k + c s d]λ + c s k.

    Without friction s = σω²/(a₂a₁ − a₀), c = a₂, k = a₀/(c s) with a₂ = 2ζω + σ, a₁ = ω² + 2ζωσ, a₀ = σω², positive for
    every ω, ζ and σ. With friction s solves an equation of fourth order; where that has no answer with c > 0 the real
    pole is faster: friction is then in it.
    """

    kinds: ClassVar[dict[str, str]] = {"stiffness": "force", "damping": "force", "force_gain": "ratio"}

    def place(self, friction: float) -> Placed:
        """Return k, c and s."""
        sigma = self.further * self.bandwidth
        for _ in range(_ROUNDS):
            polynomial = np.polymul(self.pair, [1.0, sigma])
            gains = _matched(polynomial, friction)
            if gains is not None:
                return Placed(gains, np.roots(polynomial).astype(complex), exact=True)
            sigma *= _RAISED
        raise PHControlError(f"no gains of force feedback put poles at {self.bandwidth:g} rad/s against friction")


def _matched(polynomial: np.ndarray, friction: float) -> dict[str, float] | None:
    """Return the gains with the least s; None where there are none that are positive."""
    a2, a1, a0 = (float(each) for each in polynomial[1:])
    if friction == 0.0:
        found = [a0 / (a1 * a2 - a0)]
    else:  # with c s = s(a₂ − d) − s²d =: e the middle coefficient reads d e² − a₁ e + (1 + s)a₀ = 0
        e = np.array([-friction, a2 - friction, 0.0])
        equation = np.polyadd(np.polysub(friction * np.polymul(e, e), a1 * e), [a0, a0])
        roots = np.roots(equation)
        found = sorted(float(root.real) for root in roots if abs(root.imag) <= 1e-9 * abs(root) and root.real > 0.0)
    for s in found:
        c = a2 - (1.0 + s) * friction
        if c > 0.0:
            return {"stiffness": a0 / (c * s), "damping": c, "force_gain": s}
    return None
