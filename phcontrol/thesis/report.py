"""The page of a reproduction: the thesis in its order, each figure beside its claims, theorems, certificates."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from typing import Any

from phcontrol.thesis.grasping_readings import grasping_by_reading
from phcontrol.thesis.report_claims import KINDS, claim_card, linked
from phcontrol.thesis.report_tables import certificate_table, errata_and_readings, provenance, theorem_table
from phcontrol.thesis.tally import Tally
from phcontrol.thesis.verdict import Verdict

CHAPTERS = {
    "2": "Chapter 2: the arm and its gripper",
    "3": "Chapter 3: position control",
    "4": "Chapter 4: force control and grasping",
    "5": "Chapter 5: visual servoing",
    "6": "Chapter 6: trajectory tracking",
}
PROOFS = ("theorems", "statements")
"""The studies of what the thesis states in words and equations."""
FILTERS = {"all": "all", "good": "as printed", "mended": "with a correction", "read": "under a reading",
           "weak": "fitted or vacuous", "bad": "not reproduced"}  # fmt: skip


def report(results: Mapping[str, Any]) -> str:
    """Return the page of what ``reproduce`` collected; its links lead into the folder beside it."""
    style = (resources.files("phcontrol.visualization") / "assets" / "report.css").read_text(encoding="utf-8")
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">',
            f"<title>The thesis, reproduced</title>\n<style>\n{style}</style>\n</head>\n<body>",
            *_head(results),
            *_sections(results["studies"]),
            *theorem_table(results["certificates"]),
            *certificate_table(results["certificates"]),
            *errata_and_readings(),
            *provenance(results),
            "</div>\n</main>\n</body>\n</html>\n",
        ]
    )


def _head(results: Mapping[str, Any]) -> Iterable[str]:
    claims = [claim for study in results["studies"] for claim in study["claims"]]
    rows = [row for row in results["certificates"] if "passed" in row]
    theirs, ours, measured = Tally.of_the_thesis(claims), Tally.of_ours(claims), Tally.of_stand_ins(claims)
    yield "<main>\n<h1>The thesis, reproduced</h1>"
    yield (
        '<p class="lead">Every figure and statement of M. Muñoz Arias, <i>Energy-based control design for mechanical '
        "systems</i> (Groningen 2015) that can be simulated, run again. A statement is counted once, under its best "
        'reading; what it rests on stands beside it: an <a href="#errata">erratum</a>, a <a href="#readings">reading'
        "</a>, what we chose. What was fitted, or could not fail, does not count as reproduced; what the thesis "
        "measured on the arm, where we could only simulate, is counted apart. Repeat it with "
        '<code>phcontrol reproduce --fresh --out DIR</code>; all numbers are in <a href="claims.json">claims.json</a>.'
        "</p>"
    )
    yield '<div class="totals">'
    yield f'<div class="total wide"><b>{theirs.reproduced} of {theirs.total}</b>of the thesis\'s claims reproduced'
    yield from _bar(theirs)
    yield "</div>"
    if measured.total:
        yield (
            f'<div class="total wide"><b>{measured.reproduced} of {measured.total}</b>of what it measured on the arm, '
            "for which simulations stand in: no evidence of what the arm did"
        )
        yield from _bar(measured)
        yield "</div>"
    yield f'<div class="total"><b>{ours.reproduced} of {ours.total}</b>of our own met</div>'
    yield f'<div class="total"><b>{sum(row["passed"] for row in rows)} of {len(rows)}</b>certificates passed</div>'
    yield "</div>"
    for name, reason in results["failed"].items():
        yield f'<p class="failed"><b>{escape(name)}</b> did not run to its end: {escape(reason)}</p>'
    yield '<nav class="chapters">' + "".join(
        f'<a href="#{anchor}">{escape(title)}</a>' for anchor, title, _ in _parts(results["studies"])
    ) + '<a href="#theorems-and-certificates">theorem by theorem</a><a href="#errata">errata</a></nav>'  # fmt: skip
    for name, text in FILTERS.items():
        checked = " checked" if name == "all" else ""
        yield f'<input type="radio" name="show" id="only-{name}"{checked}><label for="only-{name}">{text}</label>'
    yield '<div class="studies">'


def _bar(tally: Tally) -> Iterable[str]:
    """Yield the verdicts as a bar and a legend."""
    shown = [(verdict, count) for verdict, count in tally.counts.items() if count]
    yield '<div class="bar">'
    for verdict, count in shown:
        yield f'<span class="{KINDS[verdict]} {verdict.name.lower()}" style="flex: {count}">{count}</span>'
    yield '</div><div class="legend">'
    for verdict, count in shown:
        more = {Verdict.CORRECTED: " of an erratum", Verdict.READING: " of an ambiguous text"}.get(verdict, "")
        yield f'<span class="{KINDS[verdict]}">{count} {verdict.value}{more}</span>'
    yield "</div>"


def _parts(studies: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, list[Mapping[str, Any]]]]:
    """Return anchor, title and studies of each part of the page."""
    parts: list[tuple[str, str, list[Mapping[str, Any]]]] = []
    for number, title in CHAPTERS.items():
        found = [study for study in studies if study["study"].startswith(f"fig-{number}-")]
        parts.append((f"chapter-{number}", title, found))
    parts.append(("proofs", "Theorems, proofs and statements", [s for s in studies if s["study"] in PROOFS]))
    own = [s for s in studies if not s["study"].startswith("fig-") and s["study"] not in PROOFS]
    parts.append(("own", "Studies of our own", own))
    return [part for part in parts if part[2]]


def _sections(studies: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    for anchor, title, found in _parts(studies):
        yield f'<h2 id="{anchor}">{escape(title)}</h2>'
        yield from (f"<p>Under {linked(text)}.</p>" for text in grasping_by_reading(found))
        for study in found:
            yield from _study(study)


def _study(study: Mapping[str, Any]) -> Iterable[str]:
    name = escape(study["study"])
    title = re.sub(r" \(thesis figure [0-9.]+\)", "", study["title"]) if name.startswith("fig-") else study["title"]
    number = f"Figure {name[4:].replace('-', '.')}: " if name.startswith("fig-") else ""
    yield f'<section class="study" id="{name}"><h3>{number}{escape(title)}</h3><div class="beside">'
    yield '<div class="figures">'
    for figure in study["figures"]:
        source = f"{name}/{escape(figure)}.png"
        yield f'<a class="figure" href="{source}"><img src="{source}" alt="{escape(figure)}" loading="lazy"></a>'
    notes = "".join(f"<p>{linked(note)}</p>" for note in study["notes"])
    yield f'<div class="notes">{notes}{_links(study)}</div></div>'
    yield '<div class="claims">'
    for claim in sorted(study["claims"], key=lambda claim: claim["origin"] == "ours"):
        yield from claim_card(claim)
    yield "</div></div></section>"


def _links(study: Mapping[str, Any]) -> str:
    name = study["study"]
    if not study["logs"]:
        return ""
    links = [
        f'{escape(log)} (<a href="{escape(f"{name}/{log}.npz")}">log</a>'
        + (f', <a href="{escape(f"{name}/{log}.html")}">play</a>)' if log in study["recordings"] else ")")
        for log in study["logs"]
    ]
    return f'<details class="links"><summary>{len(links)} runs</summary>{"; ".join(links)}</details>'
