"""The page of a sweep: what it supports, quantiles, maps, and the worst runs with the commands that replay them."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from importlib import resources
from pathlib import Path

import numpy as np

from phcontrol._files import write_text
from phcontrol._validation import choice
from phcontrol.sweeps.report_figures import SHOWN, influence, maps_figure, quantiles_figure
from phcontrol.sweeps.sweep_results import SweepResults
from phcontrol.visualization.plots import save_figure

PAGE, MAPS, QUANTILES = "report.html", "maps.png", "quantiles.png"
"""What a report writes beside the results."""
_PARTS = (0.5, 0.9, 0.99, 0.999, 1.0)
_WORST = 5


def write_report(
    results: SweepResults, *, spec: str = "SPEC.toml", measure: str | None = None, confidence: float = 0.95
) -> list[Path]:
    """Write ``report.html`` and its pictures into the folder of a sweep; return where.

    Args:
        results: of the sweep.
        spec: what the commands that replay runs call its file.
        measure: what the maps show; by default the required one that the fewest runs keep, or the first.
        confidence: of what is said about all that could be drawn.
    """
    shown = choice("measure", measure, results.measures) if measure else _tightest(results)
    folder = results.folder
    return [
        save_figure(maps_figure(results, shown), folder / MAPS),
        save_figure(quantiles_figure(results), folder / QUANTILES),
        write_text(folder / PAGE, _page(results, spec, shown, confidence)),
    ]


def _tightest(results: SweepResults) -> str:
    """Return the required measure that the fewest runs keep; the first one where nothing is required."""
    require = results.manifest["sweep"]["require"]
    kept = {name: int((results.column(name) <= float(limit)).sum()) for name, limit in require.items()}
    return min(kept, key=lambda name: kept[name]) if kept else results.measures[0]


def _page(results: SweepResults, spec: str, measure: str, confidence: float) -> str:
    style = (resources.files("phcontrol.sweeps") / "report.css").read_text(encoding="utf-8")
    sweep = results.manifest["sweep"]
    title = f"{sweep['law']['name']} on {sweep['arm']['robot']}"
    failed = int(results.failed.sum())
    good = results.statement(confidence)
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">',
            f"<title>Sweep: {escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>",
            f"<h1>{escape(title)}</h1>",
            f'<p class="lead">{escape(results.sentence(confidence))}.</p>',
            '<div class="totals">',
            f'<div class="total"><b>{good.percent} %</b>good at least, {100 * confidence:g} % sure</div>',
            f'<div class="total"><b>{good.good} of {good.runs}</b>runs good</div>',
            f'<div class="total"><b>{failed}</b>failed</div>',
            f'<div class="total"><b>{int(results.column("compiled").sum())}</b>compiled</div>',
            "</div>",
            "" if results.finished else f"<p><b>Not finished: {len(results)} of {sweep['runs']} runs.</b></p>",
            "<h2>What was measured</h2>",
            *_quantiles(results),
            f'<img src="{QUANTILES}" alt="distributions of the measures">',
            f"<h2>Where {escape(measure)} is large</h2>",
            f"<p>Of the quantities that explain most of it by themselves ({_influences(results, measure)}), in pairs: "
            "the largest value among the runs in each field; fields without a run are left empty.</p>",
            f'<img src="{MAPS}" alt="maps over pairs of quantities">',
            "<h2>The worst runs</h2>",
            *_worst(results, spec),
            *_failures(results),
            "<h2>What was drawn</h2>",
            *_drawn(results),
            f"<p>phcontrol {escape(results.manifest['phcontrol'])}, sweep {results.manifest['hash'][:16]}, "
            f"seed {sweep['sampling'].get('seed', 0)}.</p>",
            "</main>\n</body>\n</html>\n",
        ]
    )


def _wide(label: str) -> str:
    """Return the start of a table that scrolls by itself where a screen is narrow, by keyboard too."""
    return f'<div class="wide" tabindex="0" role="region" aria-label="{label}"><table>'


def _influences(results: SweepResults, measure: str) -> str:
    strongest = list(influence(results, measure).items())[:SHOWN]
    return ", ".join(f"{escape(name)} {100.0 * part:.0f} %" for name, part in strongest)


def _quantiles(results: SweepResults) -> Iterator[str]:
    columns, require = results.manifest["columns"], results.manifest["sweep"]["require"]
    heads = ["measure", "unit", "median", "90 %", "99 %", "99.9 %", "largest", "required", "kept by"]
    yield _wide("what was measured") + "<tr>" + "".join(f"<th>{head}</th>" for head in heads) + "</tr>"
    for name in results.measures:
        limit = require.get(name)
        kept = "" if limit is None else f"{int((results.column(name) <= float(limit)).sum())} of {len(results)}"
        cells = [escape(name), escape(columns[name]), *(f"{value:.4g}" for value in results.quantiles(name, _PARTS))]
        cells += ["" if limit is None else f"≤ {float(limit):g}", kept]
        yield "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
    yield "</table></div>"


def _worst(results: SweepResults, spec: str) -> Iterator[str]:
    yield _wide("the worst runs") + "<tr><th>measure</th><th>value</th><th>run</th><th>again</th></tr>"
    values, runs = {name: results.column(name) for name in results.measures}, results.column("run")
    for name in results.measures:
        for place, run in enumerate(results.worst(name, _WORST)):
            row = int(np.searchsorted(runs, run))
            again = f"phcontrol sweep {escape(spec)} --replay {run} --of {results.manifest['hash'][:8]}"
            head = f'<td rowspan="{min(_WORST, len(results))}">{escape(name)}</td>' if place == 0 else ""
            value = "failed" if results.failed[row] else f"{values[name][row]:.4g}"
            yield f"<tr>{head}<td>{value}</td><td>{run}</td><td><code>{again}</code></td></tr>"
    yield "</table></div>"


def _failures(results: SweepResults) -> Iterator[str]:
    """Yield what went wrong, each text with how often and a run of it."""
    texts, runs = results.column("error")[results.failed], results.column("run")[results.failed]
    if not len(texts):
        return
    kinds: dict[str, list[int]] = {}
    for text, run in zip(texts, runs, strict=True):
        kinds.setdefault(_without_numbers(text), []).append(int(run))
    yield "<h2>What failed</h2>" + _wide("what failed") + "<tr><th>runs</th><th>first</th><th>why</th></tr>"
    for kind, those in sorted(kinds.items(), key=lambda item: -len(item[1]))[:20]:
        yield f"<tr><td>{len(those)}</td><td>{those[0]}</td><td>{escape(kind)}</td></tr>"
    yield "</table></div>"


def _without_numbers(text: str) -> str:
    """Return an error without its numbers, so that those of one kind are counted together."""
    words = []
    for word in text.split():
        bare = word.strip("(),.:;")
        try:
            float(bare)
        except ValueError:
            words.append(word)
            continue
        words.append(word.replace(bare, "…"))
    return " ".join(words)


def _drawn(results: SweepResults) -> Iterator[str]:
    sweep, columns = results.manifest["sweep"], results.manifest["columns"]
    yield f"<p>{escape(sweep['sampling'].get('method', 'random').replace('_', ' '))}, {sweep['runs']} runs.</p>"
    yield _wide("what was drawn") + "<tr><th>quantity</th><th>unit</th><th>least</th><th>mean</th><th>largest</th></tr>"
    for name in results.parameters:
        values = results.column(name)
        mean = float(values.mean())
        mean = 0.0 if abs(mean) < 1e-6 * float(np.abs(values).max()) else mean
        numbers = "".join(f"<td>{value:.4g}</td>" for value in (values.min(), mean, values.max()))
        yield f"<tr><td>{escape(name)}</td><td>{escape(columns[name])}</td>{numbers}</tr>"
    yield "</table></div>"
