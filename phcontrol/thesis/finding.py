"""What a simulation finds of a claim, under one way to read and mend the thesis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from phcontrol._validation import choice
from phcontrol.thesis.readings import READINGS
from phcontrol.thesis.verdict import Verdict


@dataclass(frozen=True)
class Finding:
    """Our value, and all that it rests on. Raises UnknownNameError for a reading that is not listed."""

    ours: tuple[float, ...]
    """Infinite for what never happens; null in JSON."""
    erratum: str = ""
    """Corrections that were made, "E8 to E10"; empty for none."""
    reading: str = ""
    """How the text was read, keys of ``READINGS`` as "R1" or "R1, R8"; empty where it can be read in one way only."""
    chosen: str = ""
    """What the thesis leaves open, and what was taken for it."""
    fitted: bool = False
    """Whether that was chosen with the printed value in view."""
    vacuous: str = ""
    """Why the value could not have been another; empty where it could."""

    def __post_init__(self) -> None:
        for name in self.readings:
            choice("reading", name, READINGS)

    @property
    def readings(self) -> tuple[str, ...]:
        """Every reading that the value rests on."""
        return tuple(self.reading.split(", ")) if self.reading else ()

    @property
    def verdict(self) -> Verdict:
        """What agreement under these conditions amounts to."""
        if self.vacuous:
            return Verdict.VACUOUS
        if self.fitted:
            return Verdict.FITTED
        if self.reading:
            return Verdict.READING
        return Verdict.CORRECTED if self.erratum else Verdict.AS_PRINTED

    @property
    def conditions(self) -> str:
        """Reading and corrections in words: "under reading R1, with correction E15", or "as printed"."""
        parts = [f"under reading {self.reading}"] * bool(self.reading)
        parts += [f"with correction {self.erratum}"] * bool(self.erratum)
        return ", ".join(parts) or "as printed"

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {
            "ours": [float(value) if np.isfinite(value) else None for value in self.ours],
            "verdict": self.verdict.value,
            "conditions": self.conditions,
            "erratum": self.erratum,
            "reading": self.reading,
            "chosen": self.chosen,
            "fitted": self.fitted,
            "vacuous": self.vacuous,
        }
