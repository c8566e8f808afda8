"""What can be said of a printed statement once it has been simulated."""

from __future__ import annotations

from enum import Enum


class Verdict(Enum):
    """From the strongest to the weakest; the first three count as reproduced."""

    AS_PRINTED = "as printed"
    """The formulas as the thesis prints them give the printed value."""
    CORRECTED = "with correction"
    """They do once an erratum is mended."""
    READING = "under reading"
    """They do under one of several ways to read the text; see ``READINGS``."""
    FITTED = "fitted"
    """Something that the thesis does not give was chosen so that they do: a possibility, no evidence."""
    VACUOUS = "vacuous"
    """They do, and could not have failed to."""
    NOT_REPRODUCED = "not reproduced"

    @property
    def reproduced(self) -> bool:
        """Whether it counts as reproduced: what was fitted, or could not fail, does not."""
        return self in (Verdict.AS_PRINTED, Verdict.CORRECTED, Verdict.READING)
