"""A bandwidth and a damping ratio at an operating point."""

from __future__ import annotations

from phcontrol._validation import flag, positive
from phcontrol.design.design_problem import DesignProblem
from phcontrol.design.placed_gains import placed_gains
from phcontrol.design.specification import Choice, Specification


class DesiredBandwidth(Specification):
    """Poles at ω and ζ where the law rests, placed and not guessed.

    With matrices for gains every mode of the joints is there; friction around rest is reckoned with, as far as positive
    gains can. What a law's own states bring beside are real poles, the first at ``further``·ω: see
    :class:`ForceFeedbackPoles`, :class:`IntegralActionPoles`. For laws on the hand see :func:`hand_gains`.

    Args:
        bandwidth: ω [rad/s].
        damping_ratio: ζ.
        further: where the first further pole is, over ω.
        diagonal: diagonal gains: the slowest mode is at ω and ζ, the others are faster.

    Example:
        >>> from phcontrol import DesiredBandwidth, MechanicalSystem, design_gains, load_robot
        >>> system = MechanicalSystem(load_robot("ur5"))
        >>> found = design_gains("force_feedback", system, DesiredBandwidth(6.0, 0.7))
        >>> sorted(found.gains)
        ['coupling', 'damping', 'force_gain', 'stiffness']
        >>> found.deviation < 1e-3, found.stable
        (True, True)
    """

    def __init__(
        self, bandwidth: float, damping_ratio: float = 0.7, *, further: float = 1.0, diagonal: bool = False
    ) -> None:
        self.bandwidth = positive("bandwidth", bandwidth)
        self.damping_ratio = positive("damping_ratio", damping_ratio)
        self.further = positive("further", further)
        self.diagonal = flag("diagonal", diagonal)

    def choose(self, problem: DesignProblem) -> Choice:
        """Return the gains."""
        return placed_gains(problem, self.bandwidth, self.damping_ratio, further=self.further, diagonal=self.diagonal)

    def __str__(self) -> str:
        """Return ω and ζ in words."""
        kind = ", diagonal gains" if self.diagonal else ""
        return f"bandwidth {self.bandwidth:g} rad/s, damping ratio {self.damping_ratio:g}{kind}"
