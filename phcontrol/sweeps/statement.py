"""What a sample supports: how many of all that could be drawn are good, at least."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.stats import beta

from phcontrol._validation import count, number
from phcontrol.exceptions import InvalidArgumentError


@dataclass(frozen=True)
class Statement:
    """Of so many independent draws so many were good.

    The bounds are those of Clopper and Pearson ("The use of confidence or fiducial limits illustrated in the case of
    the binomial", Biometrika 26, 1934): exact, for they ask for which share p a binomial variable would be so
    extreme with probability 1 − confidence at most. The lower one solves P(X ≥ good | p) = 1 − confidence, and is the
    quantile of a beta distribution with the parameters good and runs − good + 1.

    They hold for independent draws. A Latin hypercube or a Sobol sequence fills the space more evenly; for them the
    statement is usually pessimistic, but not proved. Of a grid or a list it says nothing.

    Args:
        good: how many were.
        runs: how many there are.
        confidence: between 0 and 1.

    Example:
        >>> from phcontrol.sweeps.statement import Statement
        >>> str(Statement(1000, 1000))
        '95 % sure that at least 99.70 % are good (1000 of 1000)'
    """

    good: int
    runs: int
    confidence: float = 0.95

    def __post_init__(self) -> None:
        count("runs", self.runs)
        count("good", self.good, minimum=0)
        number("confidence", self.confidence, minimum=0.5, maximum=1.0 - 1e-12)
        if self.good > self.runs:
            raise InvalidArgumentError("good", f"must be at most {self.runs}, the number of runs, but is {self.good}")

    @property
    def at_least(self) -> float:
        """The share that is good, at least."""
        if self.good == 0:
            return 0.0
        return float(beta.ppf(1.0 - self.confidence, self.good, self.runs - self.good + 1))

    @property
    def at_most(self) -> float:
        """The share that is good, at most: another statement of the same confidence, not of both together."""
        if self.good == self.runs:
            return 1.0
        return float(beta.ppf(self.confidence, self.good + 1, self.runs - self.good))

    @property
    def percent(self) -> str:
        """``at_least`` in percent, rounded down: it must not say more than the sample does."""
        percent = 100.0 * self.at_least
        digits = 2 if percent < 99.9 else 4
        return f"{int(percent * 10**digits) / 10**digits:.{digits}f}"

    def text(self, what: str) -> str:
        """Return the statement in words; ``what`` is who is good, and how."""
        sure = f"{100.0 * self.confidence:g} % sure that at least"
        return f"{sure} {self.percent} % {what} ({self.good} of {self.runs})"

    def __str__(self) -> str:
        return self.text("are good")
