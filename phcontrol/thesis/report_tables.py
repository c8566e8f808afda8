"""The tables at the end of the report's page: theorems, certificates, errata and readings, versions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from phcontrol.thesis.errata import errata
from phcontrol.thesis.readings import READINGS
from phcontrol.thesis.report_claims import linked
from phcontrol.thesis.theorem import THEOREMS

RESIDUALS = ("matching_residual", "gradient_residual", "skewness", "indefiniteness", "largest_storage_rate")


def _scroll(label: str) -> str:
    """Return the start of a table that scrolls by itself where a screen is narrow, by keyboard too."""
    return f'<div class="scroll" tabindex="0" role="region" aria-label="{label}"><table>'


def theorem_table(rows: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """Yield each theorem with the certificates of the laws that realise it."""
    if not rows:
        return
    yield '<h2 id="theorems-and-certificates">Theorem by theorem</h2>'
    yield (
        "<p>Each closed loop that a theorem promises, held against the true one: worst matching residual over all arms "
        "and forms that were certified.</p>"
    )
    yield _scroll("theorems") + "<tr><th>theorem</th><th>says</th><th>closed loop</th><th>law</th>"
    yield "<th>certificates</th><th>worst residual</th><th>errata</th></tr>"
    for theorem in THEOREMS:
        own = [row for row in rows if row["law"] in theorem.laws and "passed" in row]
        passed = sum(row["passed"] for row in own)
        residuals = [row["matching_residual"] for row in own]
        worst = "" if not own else "not finite" if None in residuals else f"{max(residuals):.1e}"
        laws = ", ".join(f'<a href="#law-{law}">{law}</a>' for law in theorem.laws)
        colour = "good" if own and passed == len(own) else "bad"
        yield (
            f"<tr><td><b>{escape(theorem.name)}</b></td><td>{escape(theorem.statement)}</td>"
            f"<td>{escape(theorem.closed_loop)}</td><td>{laws}</td>"
            f'<td class="{colour}">{passed} of {len(own)} passed</td><td class="number">{worst}</td>'
            f"<td>{linked(theorem.errata)}</td></tr>"
        )
    yield "</table></div>"


def certificate_table(rows: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """Yield every certificate."""
    if not rows:
        return
    first = next((row for row in rows if "samples" in row), {"samples": 0, "seed": 0})
    yield '<h2 id="certificates">Certificates</h2>'
    yield (
        f"<p>At {first['samples']} states of each arm (seed {first['seed']}), drawn where laws go wrong, the closed "
        "loop's rate, by finite differences, is compared with the port-Hamiltonian system that the law promises; "
        "J<sub>d</sub> must be skew, R<sub>d</sub> positive semidefinite, and H<sub>d</sub> must not grow by more than "
        "is supplied. Where the law rests its linearised loop must be stable. A law that something drives from outside "
        "says so. Relative figures.</p>"
    )
    yield _scroll("certificates") + "<tr><th>law</th><th>arm</th><th>interconnection</th>"
    yield "<th>matching</th><th>gradient</th><th>skewness</th><th>indefiniteness of R<sub>d</sub></th>"
    yield "<th>growth of H<sub>d</sub></th><th>verdict</th></tr>"
    seen: set[str] = set()
    for row in rows:
        anchor = "" if row["law"] in seen else f' id="law-{escape(row["law"])}"'
        seen.add(row["law"])
        head = f"<td>{escape(row['law'])}</td><td>{escape(row['robot'])}</td><td>{escape(row['interconnection'])}</td>"
        if "not_for_it" in row:
            reason = f'<td colspan="6" class="reason">not for this arm: {escape(row["not_for_it"])}</td>'
            yield f"<tr{anchor}>{head}{reason}</tr>"
            continue
        numbers = "".join(
            f'<td class="number">{"not finite" if row[key] is None else f"{row[key]:.1e}"}</td>' for key in RESIDUALS
        )
        notes = [f"driven by: {row['driven_by']}"] * bool(row["driven_by"])
        notes += [f"not claimed: {row['caveat']}"] * bool(row["caveat"])
        remarks = "".join(f'<div class="reason">{escape(note)}</div>' for note in notes)
        colour = "good" if row["passed"] else "bad"
        yield f'<tr{anchor}>{head}{numbers}<td class="{colour}">{escape(row["verdict"].lower())}{remarks}</td></tr>'
    yield "</table></div>"


def errata_and_readings() -> Iterable[str]:
    """Yield what was corrected and how the text was read: what verdicts link to."""
    yield '<h2 id="readings">Readings</h2>\n<p>Where the thesis can be read in more than one way.</p><dl>'
    for name, text in READINGS.items():
        yield f'<dt id="{name}">{name}</dt><dd>{escape(text)}</dd>'
    yield "</dl>"
    yield '<h2 id="errata">Errata</h2>\n<p>From the documentation\'s page on theory, docs/theory.md.</p>'
    yield _scroll("errata") + "<tr><th>name</th><th>where</th><th>printed</th><th>should be</th></tr>"
    for entry in errata().values():
        cells = "".join(f"<td>{escape(text)}</td>" for text in (entry.where, entry.printed, entry.correct))
        yield f'<tr id="{entry.name}"><td><b>{entry.name}</b></td>{cells}</tr>'
    yield "</table></div>"


def provenance(results: Mapping[str, Any]) -> Iterable[str]:
    """Yield versions and seeds."""
    yield '<h2 id="versions">Versions and seeds</h2>\n<p>'
    yield ", ".join(f"{escape(name)} {escape(version)}" for name, version in results["versions"].items())
    yield ". One thread for each study, so that numbers do not depend on how many run at once.</p>"
    seeds = [
        f"{escape(study['study'])}/{escape(log)}: "
        + ", ".join(f"{escape(sensor)} sensor {seed}" for sensor, seed in entry.items())
        for study in results["studies"]
        for log, entry in study["seeds"].items()
    ]
    if seeds:
        yield "<p>Seeds of the noise: " + "; ".join(seeds) + ". All other studies have no random numbers.</p>"
