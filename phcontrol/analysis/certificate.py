"""What was found when a law's promise was held against a plant, and what that supports."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from phcontrol._validation import choice
from phcontrol.analysis.advice import ADVICE

MATCHING_TOLERANCE = 1e-6
"""On the matching and gradient residuals: finite differences of fourth order leave about 1e-10."""
STRUCTURE_TOLERANCE = 1e-11
"""On skewness and semidefiniteness, relative to the terms of each entry: rounding leaves about 1e-14."""
PURITY_TOLERANCE = 1e-12
"""On commands that are asked for twice."""
RUN_TOLERANCE = 5e-2
"""On the balance of H_d along runs, over a step: an integration by parabolas leaves less, a jump all of itself."""
IDLE = 1e-6
"""Share of the kinetic energy that is dissipated each second, below which there is no damping [1/s]."""
CURVATURE_TOLERANCE = 1e-8
"""Below which the smallest scaled eigenvalue of the Hessian of H_d is taken for none."""


@dataclass(frozen=True)
class Check:
    """One line of a certificate: a figure, its bound, and where the worst of it was found."""

    name: str
    value: float
    bound: float
    passed: bool
    where: str = ""

    @classmethod
    def at_most(cls, name: str, value: float, bound: float, where: str = "") -> Check:
        """Return a check that a figure does not exceed its bound; NaN does."""
        return cls(name, value, bound, bool(value <= bound), where)

    @classmethod
    def more_than(cls, name: str, value: float, bound: float, where: str = "") -> Check:
        """Return a check that a figure exceeds its bound; NaN does not."""
        return cls(name, value, bound, bool(value > bound), where)

    @property
    def relation(self) -> str:
        """Return how the figure stands to its bound."""
        if self.passed == (self.value <= self.bound):
            return "<=" if self.passed else ">"
        return ">" if self.passed else "<="

    def __str__(self) -> str:
        line = f"  {self.name:<40}{self.value:>11.2e}  {self.relation} {self.bound:<8.0e} "
        if self.passed:
            return line + "ok"
        advice = f"\n      {ADVICE[self.name]}" if self.name in ADVICE else ""
        at = "" if not self.where else " " if self.where.startswith("at ") else " at "
        return f"{line}FAILED{at}{self.where}{advice}"


@dataclass(frozen=True)
class Certificate:
    """What was found at sampled states, and at the law's rest point. ``passed`` when every line is.

    A certificate is evidence, not a proof: it says what was sampled and what that supports.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, certify, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> certificate = certify(EnergyShaping.tuned(system), system, samples=16)
        >>> certificate.verdict, certificate.samples, certificate.matching_residual < 1e-6
        ('PASSED', 16, True)
    """

    controller: str
    robot: str
    interconnection: str
    samples: int
    seed: int
    region: str
    """What was sampled, in words."""
    checks: tuple[Check, ...]
    """Every figure with its bound, in the order of the report."""
    stability: str
    """Of the linearised closed loop where the law rests: "asymptotically stable", "marginal" or "unstable"."""
    slowest: float
    """Time constant of its slowest fading mode [s]."""
    driven_by: str = ""
    """What drives the loop from outside: it is port-Hamiltonian with that as an input, and not passive without it."""
    caveat: str = ""
    """What the law itself does not claim."""
    drive_power: float | None = None
    """The most that what drives the loop brings into H_d at the sampled states [W]; None without a drive."""
    other_rests: tuple[tuple[list[float], float], ...] = ()
    """Postures [rad] at which H_d has another minimum, and by how much it is higher there than at the goal [J]."""
    jump_at_switches: float | None = None
    """Largest change of H_d where another law takes over, at some of the sampled states [J]; None without a switch."""
    jump_at_half_turns: float | None = None
    """Largest jump of H_d where a continuous joint is half a turn from its goal, at some of them [J]; None for none."""
    error: str = ""
    """What the law raised where it should have answered."""
    conditions: dict[str, float] = field(default_factory=dict)
    """What the law's claim rests on beside, at its goal and along a run if one was given: each must be positive."""

    def __getitem__(self, name: str) -> Check:
        """Return a check by its name. Raises UnknownNameError, listing the checks that were made."""
        choice("check", name, [check.name for check in self.checks])
        return next(check for check in self.checks if check.name == name)

    def _value(self, name: str) -> float:
        return next((check.value for check in self.checks if check.name == name), math.inf)

    @property
    def matching_residual(self) -> float:
        """Largest |ẋ − ((J_d − R_d)∇H_d + port f_e + drive)|, row by row, relative to the row's terms."""
        return self._value(MATCHING)

    @property
    def gradient_residual(self) -> float:
        """Largest |Ḣ_d − ∇H_dᵀẋ| relative to the power that flows: ∇H_d is to be H_d's gradient."""
        return self._value(GRADIENT)

    @property
    def skewness(self) -> float:
        """Largest |J_d + J_dᵀ|, relative."""
        return self._value(SKEWNESS)

    @property
    def indefiniteness(self) -> float:
        """How far R_d is from symmetric positive semidefinite, relative: 0 but for rounding where it is."""
        return self._value(INDEFINITENESS)

    @property
    def largest_storage_rate(self) -> float:
        """Largest Ḣ_d beyond what f_e and the drive supply, relative to the power that flows; should be ≤ 0."""
        return self._value(GROWTH)

    @property
    def matching_passed(self) -> bool:
        """Whether the closed loop is the promised one."""
        return self._passed(MATCHING, GRADIENT)

    @property
    def structure_passed(self) -> bool:
        """Whether the promised system is port-Hamiltonian: J_d skew, R_d ⪰ 0."""
        return self._passed(SKEWNESS, INDEFINITENESS)

    @property
    def storage_passed(self) -> bool:
        """Whether the storage function never grew beyond what was supplied."""
        return self._passed(GROWTH)

    @property
    def conditions_passed(self) -> bool:
        """Whether what the law's claim rests on holds."""
        return all(value > 0.0 for value in self.conditions.values())

    def _passed(self, *names: str) -> bool:
        found = [check for check in self.checks if check.name in names]
        return len(found) == len(names) and all(check.passed for check in found)

    @property
    def passed(self) -> bool:
        """Whether every line passed."""
        return not self.error and all(check.passed for check in self.checks) and self.conditions_passed

    @property
    def verdict(self) -> str:
        """Return "PASSED", "PASSED AS DRIVEN" for a loop that something drives from outside, or "FAILED"."""
        return ("PASSED AS DRIVEN" if self.driven_by else "PASSED") if self.passed else "FAILED"

    @property
    def supported(self) -> float:
        """Share of the sampled region that may still violate the promise with 5 % probability: 1 − 0.05^(1/N)."""
        return float(1.0 - 0.05 ** (1.0 / self.samples))

    def to_dict(self) -> dict[str, Any]:
        """Return figures, bounds and verdict, for JSON. What is not finite becomes None."""
        return {
            "controller": self.controller,
            "robot": self.robot,
            "interconnection": self.interconnection,
            "samples": self.samples,
            "seed": self.seed,
            "region": self.region,
            "matching_residual": _finite_or_none(self.matching_residual),
            "gradient_residual": _finite_or_none(self.gradient_residual),
            "skewness": _finite_or_none(self.skewness),
            "indefiniteness": _finite_or_none(self.indefiniteness),
            "largest_storage_rate": _finite_or_none(self.largest_storage_rate),
            "checks": [
                {
                    "name": check.name,
                    "value": _finite_or_none(check.value),
                    "bound": check.bound,
                    "passed": check.passed,
                    "where": check.where,
                }
                for check in self.checks
            ],
            "stability": self.stability,
            "slowest_time_constant": _finite_or_none(self.slowest),
            "driven_by": self.driven_by,
            "drive_power": self.drive_power,
            "other_rests": [{"position": list(place), "height": height} for place, height in self.other_rests],
            "jump_at_switches": self.jump_at_switches,
            "jump_at_half_turns": self.jump_at_half_turns,
            "caveat": self.caveat,
            "error": self.error,
            "conditions": {name: _finite_or_none(value) for name, value in self.conditions.items()},
            "supported": self.supported,
            "verdict": self.verdict,
            "passed": self.passed,
        }

    def __str__(self) -> str:
        slowest = f", slowest time constant {self.slowest:.3g} s" if math.isfinite(self.slowest) else ""
        brought = "" if self.drive_power is None else f", which brings in up to {self.drive_power:.3g} W"
        lines = [
            f"certificate of {self.controller} ({self.interconnection}) on {self.robot}: {self.verdict}",
            *(str(check) for check in self.checks),
            *(
                f"  {name}: {value:.3g}, must be > 0 {'ok' if value > 0.0 else 'FAILED'}"
                for name, value in self.conditions.items()
            ),
            f"  at rest: {self.stability}{slowest}",
            *([f"  FAILED, the law raised {self.error}"] if self.error else []),
            *([f"  driven by: {self.driven_by}{brought}"] if self.driven_by else []),
            *(
                [f"  at its switches H_d jumps by up to {self.jump_at_switches:.3g} J at the sampled states"]
                if self.jump_at_switches is not None
                else []
            ),
            *(
                [f"  half a turn off in a continuous joint H_d jumps by up to {self.jump_at_half_turns:.3g} J"]
                if self.jump_at_half_turns is not None
                else []
            ),
            *(
                f"  the arm may rest elsewhere, where H_d has another minimum, {height:.3g} J above that of the goal: "
                f"q = {np.array2string(np.array(place), precision=3, max_line_width=1000)}"
                for place, height in self.other_rests
            ),
            *([f"  not claimed: {self.caveat}"] if self.caveat else []),
            f"  sampled: {self.region}",
        ]
        if self.passed:
            lines.append(
                f"  no violation in {self.samples} states: 95 % sure that less than {100.0 * self.supported:.2g} % of "
                "the sampled region violates the promise"
            )
        return "\n".join(lines)


MATCHING = "matching residual"
GRADIENT = "gradient residual"
SKEWNESS = "skewness of J_d"
INDEFINITENESS = "indefiniteness of R_d"
GROWTH = "growth of H_d beyond what is supplied"


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
