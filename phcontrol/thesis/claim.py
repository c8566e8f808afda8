"""A printed statement, what we find of it, and whether the two agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from phcontrol.exceptions import InvalidArgumentError
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.verdict import Verdict


@dataclass(frozen=True)
class Claim:
    """One printed statement, counted once, beside what we find of it under each reading."""

    name: str
    statement: str
    origin: Origin
    source: str
    """Where in the thesis; of our own, what they aim at."""
    printed: tuple[float, ...]
    """The value that was read; of our own, the aim."""
    unit: str
    tolerance: float
    """How far ours may be off: how finely the printed value can be read."""
    findings: Sequence[Finding]
    """One for each way to read and mend it, at least one."""
    relation: Literal["=", "<=", ">="] = "="
    """How ours must stand to the printed value, within the tolerance."""
    reason: str = ""
    """Why we do not agree, or what to know where we do."""
    stand_in: bool = False
    """Whether the thesis measured it on the arm, and ours is a simulation that stands in for that: counted apart."""

    def holds(self, finding: Finding) -> bool:
        """Whether a finding is what is printed, within the tolerance. What is never, or no number, is not."""
        excess = np.subtract(finding.ours, self.printed)
        if not np.isfinite(excess).all():
            return False
        excess = {"=": np.abs(excess), "<=": excess, ">=": -excess}[self.relation]
        return bool(excess.max() <= self.tolerance)

    @property
    def best(self) -> Finding:
        """The finding that agrees under the fewest conditions; where none does, the first."""
        agreeing = [finding for finding in self.findings if self.holds(finding)]
        return min(agreeing, key=lambda finding: list(Verdict).index(finding.verdict), default=self.findings[0])

    @property
    def verdict(self) -> Verdict:
        """The verdict on the best finding. Raises InvalidArgumentError where none agrees and no reason is given."""
        if self.holds(self.best):
            return self.best.verdict
        if not self.reason:
            raise InvalidArgumentError("reason", f"claim '{self.name}' is not reproduced, so it must say why")
        return Verdict.NOT_REPRODUCED

    @property
    def verdict_text(self) -> str:
        """The verdict with what it rests on: "under reading R1, with correction E15"; of our own: "met", "not met"."""
        if not self.origin.of_the_thesis:
            return "met" if self.verdict is not Verdict.NOT_REPRODUCED else "not met"
        return self.best.conditions if self.verdict.reproduced else self.verdict.value

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {
            "name": self.name,
            "statement": self.statement,
            "origin": self.origin.value,
            "source": self.source,
            "printed": list(self.printed),
            "relation": self.relation,
            "unit": self.unit,
            "tolerance": self.tolerance,
            "verdict": self.verdict.value,
            "verdict_text": self.verdict_text,
            "best": self.findings.index(self.best),
            "findings": [finding.to_dict() | {"holds": self.holds(finding)} for finding in self.findings],
            "reason": self.reason,
            "stand_in": self.stand_in,
        }

    def __str__(self) -> str:
        measured = " (measured; ours is a simulation)" if self.stand_in else ""
        whose = "thesis" if self.origin.of_the_thesis else "aim"
        sign = "" if self.relation == "=" else f"{self.relation} "
        printed = f"{whose} {sign}{_text(self.printed, self.unit)}"
        lines = [f"  {self.verdict_text}: {self.statement}{measured}: {printed}"]
        for finding in self.findings:
            notes = [finding.chosen, finding.vacuous and f"could not fail: {finding.vacuous}"]
            value = _text(finding.ours, self.unit)
            under = finding.conditions if self.origin.of_the_thesis else "ours"
            lines.append(f"      {'; '.join([f'{under}: {value}', *filter(None, notes)])}")
        return "\n".join([*lines, *([f"      {self.reason}"] if self.reason else [])])


def _text(values: tuple[float, ...], unit: str) -> str:
    if not np.isfinite(values).all():
        return "never"
    numbers = ", ".join(f"{value:.4g}" for value in values)
    return f"{f'({numbers})' if len(values) > 1 else numbers} {unit}".rstrip()
