"""The errata of the thesis, as the page on theory lists them: there they are written, and only there."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

HERE = Path(__file__).parent
PAGES = (HERE / "theory.md", HERE.parents[1] / "docs" / "theory.md")
"""Where the page is: beside this module in a wheel, in docs/ of a checkout."""


@dataclass(frozen=True)
class Erratum:
    """What is printed, and what it should be."""

    name: str
    """ "E12"."""
    where: str
    printed: str
    correct: str


@cache
def errata() -> dict[str, Erratum]:
    """Return all errata by name, in their order; none where the page is not installed."""
    page = next((path for path in PAGES if path.is_file()), None)
    if page is None:
        return {}
    rows = re.findall(r"^\| (E\d+) \|(.*)\|$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = {}
    for name, rest in rows:
        cells = [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", rest)]
        if len(cells) >= 3:
            found[name] = Erratum(name, *cells[:3])
    return dict(sorted(found.items(), key=lambda item: int(item[0][1:])))
