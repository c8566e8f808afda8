"""The page that shows a run: one HTML file that needs nothing else, not even a network."""

from __future__ import annotations

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
from phcontrol.exceptions import PHControlError
from phcontrol.visualization.live_controls import LiveControls
from phcontrol.visualization.shapes import encode
from phcontrol.visualization.stage import Stage


def page(
    stage: Stage, frames: Array, *, live: bool = False, script: str | None = None, controls: LiveControls | None = None
) -> str:
    """Return the page of a stage and its frames, shape (N, columns).

    A live page hears of more frames by itself. ``script`` is the address of MeshCat's script, for pages that share
    one; by default it is part of the page. ``controls`` are for a live page.
    """
    center, radius = stage.extent(frames[np.linspace(0, len(frames) - 1, 5).astype(int)])
    run = stage.to_dict() | {
        "live": live,
        "controls": None if controls is None else controls.to_dict(),
        "center": center,
        "radius": max(radius, 1e-2),
        "frames": None if live else encode(frames, np.float32),
    }
    parts = {
        "title": html.escape(stage.title),
        "style": _asset("player.css"),
        "meshcat": f"<script>\n{meshcat_script()}\n</script>"
        if script is None
        else f'<script src="{script}"></script>',
        "run": _embedded(run),
        "player": _asset("player.js"),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _asset("player.html"))


def _embedded(data: Any) -> str:
    """Return JSON that may stand inside a script element. Raises PHControlError for numbers that are not finite."""
    try:
        return json.dumps(data, allow_nan=False).replace("<", "\\u003c")
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
