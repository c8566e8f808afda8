"""How many claims come to which verdict: the thesis's and ours apart."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from phcontrol.thesis.origin import Origin
from phcontrol.thesis.verdict import Verdict


@dataclass(frozen=True)
class Tally:
    """Numbers of claims by verdict."""

    counts: Mapping[Verdict, int]

    @classmethod
    def of(cls, claims: Iterable[Mapping[str, Any]], origins: Iterable[Origin]) -> Tally:
        """Count claims, as ``Claim.to_dict`` writes them, of some origins."""
        wanted = set(origins)
        verdicts = [Verdict(claim["verdict"]) for claim in claims if Origin(claim["origin"]) in wanted]
        return cls({verdict: verdicts.count(verdict) for verdict in Verdict})

    @classmethod
    def of_the_thesis(cls, claims: Iterable[Mapping[str, Any]]) -> Tally:
        """Count what the thesis proves, says or simulates; what it measured on the arm is counted apart."""
        shown = [claim for claim in claims if not claim["stand_in"]]
        return cls.of(shown, [origin for origin in Origin if origin.of_the_thesis])

    @classmethod
    def of_stand_ins(cls, claims: Iterable[Mapping[str, Any]]) -> Tally:
        """Count what the thesis measured on the arm, for which a simulation stands in here."""
        measured = [claim for claim in claims if claim["stand_in"]]
        return cls.of(measured, [origin for origin in Origin if origin.of_the_thesis])

    @classmethod
    def of_ours(cls, claims: Iterable[Mapping[str, Any]]) -> Tally:
        """Count what only we state."""
        return cls.of(claims, [Origin.OURS])

    @classmethod
    def under(cls, claims: Iterable[Mapping[str, Any]], reading: str) -> Tally:
        """Count what the thesis states by the verdict under one reading; what was run under no such is left out."""
        verdicts = []
        for claim in claims:
            findings = [entry for entry in claim["findings"] if reading in entry["reading"].split(", ")]
            if findings and Origin(claim["origin"]).of_the_thesis:
                held = [Verdict(entry["verdict"]) for entry in findings if entry["holds"]]
                verdicts.append(min(held, key=list(Verdict).index, default=Verdict.NOT_REPRODUCED))
        return cls({verdict: verdicts.count(verdict) for verdict in Verdict})

    @property
    def total(self) -> int:
        """All claims."""
        return sum(self.counts.values())

    @property
    def reproduced(self) -> int:
        """Those that count as reproduced; what was fitted or could not fail does not."""
        return sum(count for verdict, count in self.counts.items() if verdict.reproduced)

    @property
    def by_verdict(self) -> str:
        """Return "3 as printed, 20 with correction, …", what is nought left out."""
        return ", ".join(f"{count} {verdict.value}" for verdict, count in self.counts.items() if count) or "none"
