"""How a claim is shown on the report's page: verdict, statement, both values, and what they rest on."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from phcontrol.thesis.origin import Origin
from phcontrol.thesis.verdict import Verdict

KINDS = {
    Verdict.AS_PRINTED: "good",
    Verdict.CORRECTED: "mended",
    Verdict.READING: "read",
    Verdict.FITTED: "weak",
    Verdict.VACUOUS: "weak",
    Verdict.NOT_REPRODUCED: "bad",
}
"""The colour of each verdict; a class of the style sheet."""


def kind(claim: Mapping[str, Any]) -> str:
    """Return the class of a claim's verdict; of our own there are two."""
    verdict = Verdict(claim["verdict"])
    return KINDS[verdict] if Origin(claim["origin"]).of_the_thesis or not verdict.reproduced else "good"


def linked(text: str) -> str:
    """Return text, safe for HTML, with each erratum and reading in it a link to its place on the page."""
    return re.sub(r"\b([ER]\d+)\b", r'<a href="#\1">\1</a>', escape(text))


def claim_card(claim: Mapping[str, Any]) -> Iterable[str]:
    """Yield the lines of one claim."""
    best = claim["findings"][claim["best"]]
    theirs = "thesis" if Origin(claim["origin"]).of_the_thesis else "aim"
    sign = {"=": "", "<=": "≤ ", ">=": "≥ "}[claim["relation"]]
    yield f'<div class="claim {kind(claim)}"><span class="verdict">{linked(claim["verdict_text"])}</span>'
    badge = '<span class="stand-in">measured on the arm; ours is a simulation</span>' if claim["stand_in"] else ""
    yield f'<p class="statement">{escape(claim["statement"])}{badge}</p>'
    yield (
        f'<p class="numbers"><span>{theirs} <b>{sign}{values(claim["printed"], claim["unit"])}</b></span>'
        f"<span>ours <b>{values(best['ours'], claim['unit'])}</b></span>"
        f'<span class="where">{escape(claim["origin"])}: {escape(claim["source"])}</span></p>'
    )
    if claim["reason"]:
        yield f'<p class="reason">{linked(claim["reason"])}</p>'
    if len(claim["findings"]) > 1 or best["chosen"] or best["vacuous"]:
        yield "<details><summary>what it rests on</summary><ul>"
        for finding in claim["findings"]:
            notes = [
                f"<b>{values(finding['ours'], claim['unit'])}</b> {linked(finding['conditions'])}",
                *([f"chosen: {escape(finding['chosen'])}"] * bool(finding["chosen"])),
                *(["chosen for the printed value"] * finding["fitted"]),
                *([f"could not fail: {escape(finding['vacuous'])}"] * bool(finding["vacuous"])),
            ]
            yield f"<li>{'; '.join(notes)}</li>"
        yield "</ul></details>"
    yield "</div>"


def values(numbers: Iterable[float | None], unit: str) -> str:
    """Return numbers with their unit, safe for HTML."""
    texts = ["never" if number is None else f"{number:.4g}" for number in numbers]
    return escape(", ".join(texts) + ("" if "never" in texts else f" {unit}".rstrip()))
