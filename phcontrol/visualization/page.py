"""The page that shows runs: one HTML file that needs nothing else, not even a network."""

from __future__ import annotations

import base64
import gzip
import html
import importlib.util
import json
import re
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from phcontrol.analysis.certificate import Certificate
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.visualization.live_controls import LiveControls
from phcontrol.visualization.shapes import differences
from phcontrol.visualization.shown_run import ShownRun

MOST_RUNS = 4
"""Runs on one page at most: more lines over each other are not told apart."""


def page(
    runs: Sequence[ShownRun],
    *,
    live: bool = False,
    script: str | None = None,
    controls: LiveControls | None = None,
    certificate: Certificate | None = None,
) -> str:
    """Return the page of runs side by side under one time, their signals over each other.

    A live page has one run, and hears of more frames by itself. ``script`` is the address of MeshCat's script, for
    pages that share one; by default it is part of the page, compressed as all of the runs are. ``controls`` are for a
    live page. ``certificate`` is shown as a badge.

    Raises InvalidArgumentError for more runs than lines can be told apart.
    """
    if not 1 <= len(runs) <= MOST_RUNS:
        raise InvalidArgumentError("logs", f"must be 1 to {MOST_RUNS} runs for a page, but are {len(runs)}")
    extents = [run.stage.extent(run.frames[np.linspace(0, len(run.frames) - 1, 25).astype(int)]) for run in runs]
    centers = np.array([center for center, _, _ in extents])
    center = 0.5 * (centers.min(axis=0) + centers.max(axis=0))
    radius = max(
        float(np.linalg.norm(own - center)) + reach for own, (_, reach, _) in zip(centers, extents, strict=True)
    )
    common = {
        "center": [float(part) for part in center],
        "radius": max(radius, 1e-2),
        "floor": min(floor for _, _, floor in extents),
        "live": live,
        "controls": None if controls is None else controls.to_dict(),
        "certificate": None
        if certificate is None
        else {"verdict": certificate.verdict, "passed": certificate.passed, "text": str(certificate)},
    }
    shown = [
        run.stage.to_dict()
        | common
        | {"name": run.name, "frames": None if live else differences(run.frames.astype("<f4").view("<u4"), bits=32)}
        for run in runs
    ]
    parts = {
        "title": html.escape(" beside ".join(run.stage.title for run in runs)),
        "style": _asset("player.css"),
        "meshcat": f'<script id="meshcat" type="application/gzip">{_packed_meshcat()}</script>'
        if script is None
        else f'<script src="{script}"></script>',
        "run": _packed(_embedded(shown)),
        "player": "\n".join(
            _asset(f"{name}.js") for name in ("track", "scene", "charts", "camera_image", "controls", "player")
        ),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _asset("player.html"))


def _packed(text: str) -> str:
    """Return a text compressed, as letters: browsers unpack it themselves."""
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


@cache
def _packed_meshcat() -> str:
    return _packed(meshcat_script())


def _embedded(data: Any) -> str:
    """Return JSON. Raises PHControlError for numbers that are not finite."""
    try:
        return json.dumps(data, allow_nan=False)
    except ValueError as error:
        raise PHControlError("this run cannot be shown: a number of what stands in it is not finite") from error


def _asset(name: str) -> str:
    return (resources.files("phcontrol.visualization") / "assets" / name).read_text(encoding="utf-8")


@cache
def meshcat_script() -> str:
    """Return MeshCat's script, found without importing its Python package, which takes a second."""
    spec = importlib.util.find_spec("meshcat")
    places = [] if spec is None else list(spec.submodule_search_locations or ())
    for place in places:
        path = Path(place) / "viewer" / "dist" / "main.min.js"
        if path.is_file():
            return path.read_text(encoding="utf-8").replace("</script", "<\\/script")
    raise PHControlError("the viewer needs meshcat: pip install meshcat")
