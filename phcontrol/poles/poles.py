"""Where the poles of one direction of motion are put."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

from phcontrol._validation import Array, positive

SHARE = 0.1
"""Of the desired damping, which a law injects at least where friction damps more than is desired."""


class Placed(NamedTuple):
    """The gains of one direction in the arm's inertia as unit, and the poles that they give."""

    gains: dict[str, float]
    """By the arguments of the law; a stiffness in 1/s², a damping in 1/s."""
    poles: Array
    """Complex [1/s]."""
    exact: bool
    """Whether they are those of the specification; else friction stands in the way."""


class Poles(ABC):
    """A pair of poles at ω and ζ, and where a law's own states put more, real ones at ``further``·ω and beyond.

    With M = T Tᵀ, q̄ = Tᵀq̃ and D̄ = T⁻¹D T⁻ᵀ all gains that are functions of D̄ leave one loop for each of its
    eigenvalues d; with no friction all of them are the same. A subclass says which gains match the polynomial.

    Args:
        bandwidth: ω [rad/s].
        damping_ratio: ζ.
        further: of the first real pole, over ω.
    """

    kinds: ClassVar[dict[str, str]]
    """Of each gain: "force" (of a displacement or a velocity), "ratio" (of momenta), or "rate" (of displacements)."""

    def __init__(self, bandwidth: float, damping_ratio: float, further: float = 1.0) -> None:
        self.bandwidth = positive("bandwidth", bandwidth)
        self.damping_ratio = positive("damping_ratio", damping_ratio)
        self.further = positive("further", further)

    @classmethod
    def arguments(cls) -> tuple[str, ...]:
        """Return the arguments of a law that the poles are placed with: none of them can be given beside."""
        return ("potential", "integral_compliance", *cls.kinds, "coupling")

    @property
    def pair(self) -> list[float]:
        """λ² + 2ζωλ + ω², highest power first."""
        return [1.0, 2.0 * self.damping_ratio * self.bandwidth, self.bandwidth**2]

    @abstractmethod
    def place(self, friction: float) -> Placed:
        """Return the gains of a direction with a friction d [1/s].

        Raises PHControlError where no positive gains put the poles there.
        """
