"""The pictures of a sweep's report."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from scipy.stats import rankdata

from phcontrol._validation import Array
from phcontrol.sweeps.sweep_results import SweepResults
from phcontrol.visualization.colors import COLORS, INK

SHOWN = 4
"""How many quantities the maps pair."""
_EMPTY_PART = 8  # runs in a field, on average, of which maps are made
_CLASSES = 10
_FIELDS = 24  # at most, in a row of a map


def influence(results: SweepResults, measure: str) -> dict[str, float]:
    """Return which part of a measure each quantity explains by itself, the largest first.

    Of the measure's ranks over the runs that did not fail: the variance of their means in ten classes of the quantity
    with equally many runs, over their variance (the correlation ratio η²), adjusted for what chance alone explains. It
    finds what is worst in the middle or at both ends, too, where a correlation is zero.
    """
    kept = ~results.failed
    ranks = rankdata(results.column(measure)[kept])
    found = {name: _explained(results.column(name)[kept], ranks) for name in results.parameters}
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _explained(column: Array, ranks: Array) -> float:
    classes = min(_CLASSES, len(ranks) // _EMPTY_PART)
    if classes < 2 or not np.ptp(column) > 0.0 or not np.ptp(ranks) > 0.0:
        return 0.0
    place = np.searchsorted(np.unique(np.quantile(column, np.linspace(0.0, 1.0, classes + 1))[1:-1]), column)
    counts = np.bincount(place)
    means = np.bincount(place, ranks) / np.maximum(counts, 1)
    ratio = float((counts * (means - ranks.mean()) ** 2).sum() / ((ranks - ranks.mean()) ** 2).sum())
    return max(0.0, 1.0 - (1.0 - ratio) * (len(ranks) - 1) / (len(ranks) - int((counts > 0).sum())))


def maps_figure(results: SweepResults, measure: str) -> Figure:
    """Return maps of a measure's largest value over pairs of the quantities that go with it most."""
    strength = influence(results, measure)
    names = list(strength)[:SHOWN]
    pairs: list[tuple[str, ...]] = list(combinations(names, 2)) or [(names[0],)]
    columns = min(3, len(pairs))
    rows = -(-len(pairs) // columns)
    figure = Figure(figsize=(4.4 * columns, 3.7 * rows + 0.5), layout="constrained")
    unit = results.manifest["columns"][measure]
    figure.suptitle(f"largest {measure}" + (f" [{unit}]" if unit else ""), color=INK)
    kept = ~results.failed
    values = results.column(measure)[kept]
    finite = values[np.isfinite(values)]
    few = len(pairs[0]) == 1 or len(values) < 4 * _EMPTY_PART
    drawn = [[results.column(name)[kept] for name in pair] for pair in pairs]
    maps = [] if few else [_largest(across, up, values) for across, up in drawn]
    seen = finite if few else np.concatenate([table[np.isfinite(table)] for _, _, table in maps])
    style: dict[str, Any] = {"norm": _norm(seen), "cmap": "viridis"}
    image: Any = None
    for place, pair in enumerate(pairs):
        axes = figure.add_subplot(rows, columns, place + 1)
        if few:
            up = drawn[place][1] if len(pair) > 1 else values
            shown = np.where(np.isfinite(values), values, finite.max(initial=1.0))
            image = axes.scatter(drawn[place][0], up, c=shown, s=18, **style)
        else:
            across, up, table = maps[place]
            image = axes.pcolormesh(across, up, np.ma.array(table, mask=table == -np.inf), **style)
        axes.set_xlabel(_label(results, pair[0]))
        axes.set_ylabel(_label(results, pair[1]) if len(pair) > 1 else measure)
    if image is not None:
        figure.colorbar(image, ax=figure.axes, shrink=0.9)
    return figure


def _largest(across: Array, up: Array, values: Array) -> tuple[Array, Array, Array]:
    """Return the edges of fields of a plane, and the largest value in each: −∞ where there is none."""
    fields = int(np.clip(np.sqrt(len(values) / _EMPTY_PART), 3, _FIELDS))
    places, edges = [], []
    for column in (across, up):
        distinct = np.unique(column)
        if len(distinct) <= fields:  # a list: a field for each
            middle = 0.5 * (distinct[1:] + distinct[:-1])
            half = 0.5 * np.diff(distinct).min() if len(distinct) > 1 else 0.5
            edge = np.concatenate([[distinct[0] - half], middle, [distinct[-1] + half]])
        else:  # between the outermost percents: tails are drawn into the outer fields
            low, high = np.quantile(column, [0.01, 0.99])
            edge = np.linspace(low, high, fields + 1)
        edges.append(edge)
        places.append(np.clip(np.searchsorted(edge, column, side="right") - 1, 0, len(edge) - 2))
    table = np.full((len(edges[1]) - 1, len(edges[0]) - 1), -np.inf)
    np.maximum.at(table, (places[1], places[0]), values)
    return edges[0], edges[1], table


def _norm(values: Array) -> Normalize:
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    if low > 0.0 and high > 30.0 * low:
        return LogNorm(low, high)
    return Normalize(low, high if high > low else low + 1.0)


def _label(results: SweepResults, name: str) -> str:
    unit = results.manifest["columns"][name]
    return name + (f" [{unit}]" if unit else "")


def quantiles_figure(results: SweepResults) -> Figure:
    """Return, for each measure, which part of the runs is above each value, and where the required limit is."""
    measures = results.measures
    columns = min(3, len(measures))
    rows = -(-len(measures) // columns)
    figure = Figure(figsize=(4.4 * columns, 2.9 * rows + 0.3), layout="constrained")
    figure.suptitle("part of the runs that is above", color=INK)
    require, kept = results.manifest["sweep"]["require"], ~results.failed
    for place, name in enumerate(measures):
        axes = figure.add_subplot(rows, columns, place + 1)
        values = np.sort(results.column(name)[kept])
        above = 1.0 - np.arange(len(values)) / max(1, len(values))
        finite = np.isfinite(values)
        axes.step(values[finite], above[finite], where="pre", color=COLORS[place % len(COLORS)])
        axes.set_yscale("log")
        shown = values[finite]
        if len(shown) and shown[0] > 0.0 and shown[-1] > 30.0 * shown[0]:
            axes.set_xscale("log")
        if name in require:
            limit = float(require[name])
            axes.axvline(limit, color=INK, linestyle="--", linewidth=0.9)
            place_of_text = axes.get_xaxis_transform()  # along the line, inside the axes
            style: dict[str, Any] = {"rotation": 90, "va": "bottom", "ha": "right", "fontsize": 8, "color": INK}
            axes.text(limit, 0.04, "required ", transform=place_of_text, **style)
        axes.set_xlabel(_label(results, name))
        axes.grid(alpha=0.3)
    return figure
