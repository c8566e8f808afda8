"""How the section on grasping fares under each of its readings, which exclude each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from phcontrol.thesis.tally import Tally

SECTION, GRASPING_READINGS = "section 4.2", ("R1", "R2")


def grasping_by_reading(studies: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return how section 4.2 fares under each of its readings, in words; a claim counts in each of its own."""
    claims = [claim for study in studies for claim in study["claims"] if SECTION in claim["source"]]
    tallies = {reading: Tally.under(claims, reading) for reading in GRASPING_READINGS}
    return [
        f"{reading}, {SECTION}: {tally.reproduced} of {tally.total} reproduced ({tally.by_verdict})"
        for reading, tally in tallies.items()
        if tally.total
    ]
