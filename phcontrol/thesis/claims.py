"""What the thesis says of a study, what we find, and whether the two agree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from phcontrol.exceptions import InvalidArgumentError


@dataclass(frozen=True)
class Claim:
    """One printed statement with its value, beside ours."""

    name: str
    statement: str
    source: str
    """Where in the thesis."""
    printed: tuple[float, ...]
    ours: tuple[float, ...]
    """Infinite for what never happens; null in JSON."""
    unit: str
    tolerance: float
    """Largest difference that counts as agreement, from how many digits are printed."""
    erratum: str = ""
    """The correction that agreement needs, "E12"; empty for none."""
    reason: str = ""
    """Why we do not agree, or what to know where we do."""

    @property
    def agrees(self) -> bool:
        """Whether ours is the printed value within the tolerance."""
        return bool(np.abs(np.subtract(self.ours, self.printed)).max() <= self.tolerance)

    @property
    def verdict(self) -> str:
        """Return "reproduced", "reproduced with correction E…" or "not reproduced"."""
        if not self.agrees:
            if not self.reason:
                raise InvalidArgumentError("reason", f"claim '{self.name}' is not reproduced, so it must say why")
            return "not reproduced"
        return f"reproduced with correction {self.erratum}" if self.erratum else "reproduced"

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {
            "name": self.name,
            "statement": self.statement,
            "source": self.source,
            "printed": list(self.printed),
            "ours": [float(value) if np.isfinite(value) else None for value in self.ours],
            "unit": self.unit,
            "tolerance": self.tolerance,
            "verdict": self.verdict,
            "erratum": self.erratum,
            "reason": self.reason,
        }

    def __str__(self) -> str:
        def values(numbers: tuple[float, ...]) -> str:
            if not np.isfinite(numbers).all():
                return "never"
            return (
                "(" + ", ".join(f"{number:.4g}" for number in numbers) + ")"
                if len(numbers) > 1
                else f"{numbers[0]:.4g}"
            )

        line = (
            f"  {self.verdict}: {self.statement}: thesis {values(self.printed)}, ours {values(self.ours)} {self.unit}"
        )
        return f"{line}\n      {self.reason}" if self.reason else line
