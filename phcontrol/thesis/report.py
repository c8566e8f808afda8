"""The page of a reproduction: figures, claims, certificates, versions and seeds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from importlib import resources
from typing import Any

from phcontrol.thesis.tally import Tally
from phcontrol.thesis.verdict import Verdict

CLASSES = {
    Verdict.AS_PRINTED: "good",
    Verdict.CORRECTED: "mended",
    Verdict.READING: "mended",
    Verdict.FITTED: "weak",
    Verdict.VACUOUS: "weak",
    Verdict.NOT_REPRODUCED: "bad",
}


def report(results: Mapping[str, Any]) -> str:
    """Return the page of what ``reproduce`` collected; its links lead into the folder beside it."""
    style = (resources.files("phcontrol.visualization") / "assets" / "report.css").read_text(encoding="utf-8")
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">',
            f"<title>The thesis, reproduced</title>\n<style>\n{style}</style>\n</head>\n<body>",
            *_head(results),
            *_figures(results["studies"]),
            *_claims(results["studies"]),
            *_certificates(results["certificates"]),
            *_provenance(results),
            "</body>\n</html>\n",
        ]
    )


def _head(results: Mapping[str, Any]) -> Iterable[str]:
    claims = [claim for study in results["studies"] for claim in study["claims"]]
    theirs, ours = Tally.of_the_thesis(claims), Tally.of_ours(claims)
    rows = [row for row in results["certificates"] if "passed" in row]
    totals = [
        (f"{theirs.reproduced} of {theirs.total}", f"of the thesis's claims reproduced: {theirs.by_verdict}", "good"),
        (f"{ours.reproduced} of {ours.total}", "of our own met", "good"),
        (f"{sum(row['passed'] for row in rows)} of {len(rows)}", "certificates passed", "good"),
    ]  # fmt: skip
    yield "<h1>The thesis, reproduced</h1>"
    yield (
        "<p>Every figure and statement of M. Muñoz Arias, <i>Energy-based control design for mechanical systems</i> "
        "(Groningen 2015) that can be simulated, run again with the laws as corrected. Errata (E…) are listed in the "
        "documentation's page on theory. Repeat it with <code>phcontrol reproduce --fresh --out DIR</code>; the "
        'numbers are also in <a href="claims.json">claims.json</a>.</p>'
    )
    yield '<div class="totals">'
    for value, label, kind in totals:
        yield f'<div class="total"><b class="{kind}">{value}</b>{label}</div>'
    yield "</div>"
    for name, reason in results["failed"].items():
        yield f'<p class="failed"><b>{escape(name)}</b> did not run to its end: {escape(reason)}</p>'


def _figures(studies: Iterable[Mapping[str, Any]]) -> Iterable[str]:
    yield '<h2 id="figures">Figures, in the thesis\'s order</h2>\n<div class="figures">'
    for study in studies:
        name = escape(study["study"])
        for position, figure in enumerate(study["figures"]):
            source = f"{name}/{escape(figure)}.png"
            yield (
                f'<figure class="figure"{f" id={chr(34)}{name}{chr(34)}" if position == 0 else ""}>'
                f'<a href="{source}"><img src="{source}" alt="{escape(figure)}" loading="lazy"></a>'
                f"<figcaption><b>{name}</b>: {escape(study['title'])}"
                + "".join(f"<br>{escape(note)}" for note in (study["notes"] if position == 0 else ()))
                + f"{_links(study) if position == 0 else ''}</figcaption></figure>"
            )
    yield "</div>"


def _links(study: Mapping[str, Any]) -> str:
    name = study["study"]
    if not study["logs"]:
        return ""
    links = [
        f'{escape(log)} (<a href="{escape(f"{name}/{log}.npz")}">log</a>'
        + (f', <a href="{escape(f"{name}/{log}.html")}">play</a>)' if log in study["recordings"] else ")")
        for log in study["logs"]
    ]
    return f'<p class="links">runs: {"; ".join(links)}</p>'


def _claims(studies: Iterable[Mapping[str, Any]]) -> Iterable[str]:
    yield '<h2 id="claims">Claims</h2>'
    yield '<input type="radio" name="show" id="all" checked><label for="all"> all </label>'
    yield '<input type="radio" name="show" id="only-mended"><label for="only-mended"> with a correction </label>'
    yield '<input type="radio" name="show" id="only-not"><label for="only-not"> not reproduced </label>'
    yield '<div class="scroll"><table><tr class="head"><th>statement</th><th>where</th><th>thesis</th><th>ours</th>'
    yield "<th>verdict</th></tr>"
    for study in studies:
        name = escape(study["study"])
        link = f'<a href="#{name}">{name}</a>'
        yield f'<tr class="study"><td colspan="5">{link}: {escape(study["title"])}{_links(study)}</td></tr>'
        for claim in study["claims"]:
            kind, best = CLASSES[Verdict(claim["verdict"])], claim["findings"][claim["best"]]
            reason = f'<div class="reason">{escape(claim["reason"])}</div>' if claim["reason"] else ""
            yield (
                f'<tr class="{kind}"><td>{escape(claim["statement"])}{reason}</td><td>{escape(claim["source"])}</td>'
                f'<td class="number">{_values(claim["printed"], claim["unit"])}</td>'
                f'<td class="number">{_values(best["ours"], claim["unit"])}</td>'
                f'<td class="{kind}">{escape(claim["verdict_text"])}</td></tr>'
            )
    yield "</table></div>"


def _values(values: Iterable[float | None], unit: str) -> str:
    numbers = ["never" if value is None else f"{value:.4g}" for value in values]
    return escape(", ".join(numbers) + ("" if numbers == ["never"] else f" {unit}"))


def _certificates(rows: Iterable[Mapping[str, Any]]) -> Iterable[str]:
    rows = list(rows)
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
    yield '<div class="scroll"><table><tr class="head"><th>law</th><th>arm</th><th>interconnection</th>'
    yield "<th>matching</th><th>gradient</th><th>skewness</th><th>indefiniteness of R<sub>d</sub></th>"
    yield "<th>growth of H<sub>d</sub></th><th>verdict</th></tr>"
    for row in rows:
        head = f"<td>{escape(row['law'])}</td><td>{escape(row['robot'])}</td><td>{escape(row['interconnection'])}</td>"
        if "not_for_it" in row:
            yield f'<tr>{head}<td colspan="6" class="reason">not for this arm: {escape(row["not_for_it"])}</td></tr>'
            continue
        keys = ("matching_residual", "gradient_residual", "skewness", "indefiniteness", "largest_storage_rate")
        numbers = "".join(
            f'<td class="number">{"not finite" if row[key] is None else f"{row[key]:.1e}"}</td>' for key in keys
        )
        verdict = f'<td class="{"good" if row["passed"] else "bad"}">{escape(row["verdict"].lower())}</td>'
        notes = [f"driven by: {row['driven_by']}"] * bool(row["driven_by"]) + [f"not claimed: {row['caveat']}"] * bool(
            row["caveat"]
        )
        caveat = "".join(f'<div class="reason">{escape(note)}</div>' for note in notes)
        yield f"<tr>{head}{numbers}{verdict.replace('</td>', caveat + '</td>')}</tr>"
    yield "</table></div>"


def _provenance(results: Mapping[str, Any]) -> Iterable[str]:
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
