"""The modes of a linear loop: how fast, how damped, and which joints take part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phcontrol._validation import Array

_SHOWN = 0.1  # share of the motion, below which a joint is not named
_PAIRED = 1e-9  # relative size of an imaginary part that is one


@dataclass(frozen=True)
class Mode:
    """One eigenvalue of the linearised loop, or a pair of conjugate ones.

    Example:
        >>> from phcontrol import Mode
        >>> mode = Mode(eigenvalue=-2.0 + 2.0j, uncertainty=0.0, joints=(("elbow", 1.0),), own_states=0.0)
        >>> round(mode.frequency, 3), round(mode.damping_ratio, 3), mode.time_constant
        (2.828, 0.707, 0.5)
    """

    eigenvalue: complex
    """λ, of a pair that with the positive imaginary part [1/s]."""
    uncertainty: float
    """Of λ, to first order [1/s]."""
    joints: tuple[tuple[str, float], ...]
    """Names of the joints that move most in it, with their share of the motion in natural units (|q_i|²), largest
    first; those below 0.1 are left out."""
    own_states: float
    """Share of the law's own states in the mode, in natural units: near 1 the arm hardly moves in it."""

    @property
    def frequency(self) -> float:
        """ω = |λ| [rad/s]."""
        return abs(self.eigenvalue)

    @property
    def damping_ratio(self) -> float:
        """ζ = −Re λ / |λ|: 1 or more is not to be told from 1 in one real mode; NaN for λ = 0."""
        return -self.eigenvalue.real / self.frequency if self.frequency > 0.0 else np.nan

    @property
    def time_constant(self) -> float:
        """−1/Re λ [s]: in which it falls to 1/e; negative where it grows, infinite where it stays."""
        return -1.0 / self.eigenvalue.real if abs(self.eigenvalue.real) > self.uncertainty else np.inf

    @property
    def oscillates(self) -> bool:
        """Whether it is a pair; a part that is not known from 0 makes none."""
        return abs(self.eigenvalue.imag) > self.uncertainty


def modes_of(A: Array, names: tuple[str, ...], values: Array, uncertainty: Array) -> tuple[Mode, ...]:
    """Return the modes of ẏ = A y in natural units, slowest first.

    Args:
        A: in natural units of y = (q, q̇, controller state).
        names: of the joints.
        values: the eigenvalues as they are known best, complex.
        uncertainty: of each.
    """
    computed, vectors = np.linalg.eig(A)
    joints, found = len(names), []
    for value, error in zip(values, uncertainty, strict=True):
        if value.imag < 0.0:
            continue
        real = abs(value.imag) <= _PAIRED * abs(value)
        moved = np.abs(vectors[:, int(np.argmin(np.abs(computed - value)))]) ** 2
        share = moved[:joints] / max(float(moved[:joints].sum()), 1e-300)
        order = np.argsort(-share)
        taking = tuple((names[i], float(share[i])) for i in order if share[i] >= _SHOWN)
        own = float(moved[2 * joints :].sum() / moved.sum())
        found.append(Mode(complex(value.real, 0.0) if real else complex(value), float(error), taking, own))
    return tuple(sorted(found, key=lambda mode: -mode.eigenvalue.real if mode.eigenvalue.real < 0.0 else -np.inf))
