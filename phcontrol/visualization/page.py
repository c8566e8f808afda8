"""The page that shows a run: one HTML file that needs nothing else, not even a network."""

from __future__ import annotations

import base64
import gzip
import html
import importlib.util
import json
import re
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.certificate import Certificate
from phcontrol.exceptions import PHControlError
from phcontrol.visualization.live_controls import LiveControls
from phcontrol.visualization.shapes import differences
from phcontrol.visualization.stage import Stage


def page(
    stage: Stage,
    frames: Array,
    *,
    live: bool = False,
    script: str | None = None,
    controls: LiveControls | None = None,
    certificate: Certificate | None = None,
) -> str:
    """Return the page of a stage and its frames, shape (N, columns).

    A live page hears of more frames by itself. ``script`` is the address of MeshCat's script, for pages that share
    one; by default it is part of the page, compressed as all of the run is. ``controls`` are for a live page.
    ``certificate`` is shown as a badge.
    """
    center, radius, floor = stage.extent(frames[np.linspace(0, len(frames) - 1, 25).astype(int)])
    run = stage.to_dict() | {
        "live": live,
        "controls": None if controls is None else controls.to_dict(),
        "center": center,
        "radius": max(radius, 1e-2),
        "floor": floor,
        "certificate": None
        if certificate is None
        else {"verdict": certificate.verdict, "passed": certificate.passed, "text": str(certificate)},
        "frames": None if live else differences(frames.astype("<f4").view("<u4"), bits=32),
    }
    parts = {
        "title": html.escape(stage.title),
        "style": _asset("player.css"),
        "meshcat": f'<script id="meshcat" type="application/gzip">{_packed_meshcat()}</script>'
        if script is None
        else f'<script src="{script}"></script>',
        "run": _packed(_embedded(run)),
        "player": "\n".join(_asset(f"{name}.js") for name in ("scene", "charts", "camera_image", "controls", "player")),
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
