"""A control period and a delay."""

from __future__ import annotations

from phcontrol._validation import count, number, positive
from phcontrol.analysis.linearization import linearize
from phcontrol.design.design_problem import DesignProblem
from phcontrol.design.largest_bandwidth import FIRST, largest_bandwidth
from phcontrol.design.placed_gains import placed_gains
from phcontrol.design.specification import Choice, Specification
from phcontrol.exceptions import PHControlError

_FASTEST = 500.0  # bandwidth that is looked at [rad/s]


class SamplingBudget(Specification):
    """The largest bandwidth whose loop is stable with the torque held for a period, and late.

    The loop is that of :class:`SampledLoop`, about the law's rest, with the gains of :class:`DesiredBandwidth`.
    ``margin`` makes period and delay so many times as long: 2 keeps the loop stable when both double.

    Args:
        period: h, for which a torque is held [s].
        delay: by how many periods it is late.
        damping_ratio: ζ.
        margin: 1 or more.

    Example:
        >>> from phcontrol import MechanicalSystem, SamplingBudget, design_gains, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"), friction=None)
        >>> found = design_gains("energy_shaping", system, SamplingBudget(period=4e-3, delay=1))
        >>> found.linear.sampled(2 * 4e-3, 1).stable, 20.0 < found.spectrum[0].frequency < 200.0
        (True, True)
    """

    def __init__(self, period: float, delay: int = 1, *, damping_ratio: float = 0.7, margin: float = 2.0) -> None:
        self.period = positive("period", period)
        self.delay = count("delay", delay, minimum=0)
        self.damping_ratio = positive("damping_ratio", damping_ratio)
        self.margin = number("margin", margin, minimum=1.0)

    def choose(self, problem: DesignProblem) -> Choice:
        """Return the gains of the largest stable bandwidth."""

        def holds(bandwidth: float) -> bool:
            law = problem.make(**placed_gains(problem, bandwidth, self.damping_ratio).gains)
            loop = linearize(law, problem.system, exact=False)
            return loop.sampled(self.margin * self.period, self.delay).stable

        found = largest_bandwidth(holds, _FASTEST)
        if not found:
            raise PHControlError(
                f"{problem.name} on {problem.system.robot.name} is not stable at {FIRST:g} rad/s with a torque held "
                f"for {self.margin * self.period:g} s and {self.delay} periods late"
            )
        chosen = placed_gains(problem, found, self.damping_ratio)
        longest = self.margin * self.period
        note = f"the largest bandwidth is {found:.4g} rad/s: above, a period of {longest:g} s is too long"
        return chosen._replace(notes=(*chosen.notes, note))

    def __str__(self) -> str:
        """Return it in words."""
        late = f"{self.delay} period{'' if self.delay == 1 else 's'} late"
        return f"stable with a period of {self.period:g} s, {late}, and a margin of {self.margin:g}"
