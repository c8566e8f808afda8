"""What the site's build does beside MkDocs: formulas become MathML, and API pages list every public name."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

import phcontrol

FORMULA = re.compile(r'<(?P<tag>div|span) class="arithmatex">\\[\[(](?P<formula>.*?)\\[\])]</(?P=tag)>', re.DOTALL)
ROLE = re.compile(r":(?:class|func|meth):<code>(?P<name>[\w.]+)</code>")
NAMES = re.compile(r"\{\{ names of (?P<folder>\w+) \}\}")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace ``{{ names of FOLDER }}`` by the documentation of every public name that is defined there."""
    return NAMES.sub(_names, markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Replace formulas that the arithmatex extension marked (browsers draw MathML, no script is needed), and roles."""
    return ROLE.sub(_link, FORMULA.sub(_mathml, content))


def _names(match: re.Match[str]) -> str:
    prefix = f"phcontrol.{match['folder']}"
    names = [
        name for name in phcontrol.__all__ if getattr(getattr(phcontrol, name), "__module__", "").startswith(prefix)
    ]
    return "\n\n".join(f"::: phcontrol.{name}" for name in sorted(names, key=str.lower))


def _link(match: re.Match[str]) -> str:
    """Return what a docstring refers to, with a link where it is public."""
    name = match["name"].removeprefix("phcontrol.")
    target = getattr(phcontrol, name.split(".")[0], None) if name.split(".")[0] in phcontrol.__all__ else None
    if target is None:
        return f"<code>{name.split('.')[-1]}</code>"
    folder = target.__module__.split(".")[1]
    return f'<a href="{folder}.html#phcontrol.{name}"><code>{name}</code></a>'


def _mathml(match: re.Match[str]) -> str:
    display = "block" if match["tag"] == "div" else "inline"
    formula = html.unescape(match["formula"]).strip()
    return f'<{match["tag"]} class="formula">{convert(formula, display=display)}</{match["tag"]}>'
