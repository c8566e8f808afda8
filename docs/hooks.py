"""What the site's build does beside MkDocs: formulas become MathML, and API pages list every public name."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

import phcontrol
from phcontrol.analysis.advice import ADVICE
from phcontrol.controllers.registry import CONTROLLERS

FORMULA = re.compile(r'<(?P<tag>div|span) class="arithmatex">\\[\[(](?P<formula>.*?)\\[\])]</(?P=tag)>', re.DOTALL)
ROLE = re.compile(r":(?:class|func|meth):<code>(?P<name>[\w.]+)</code>")
NAMES = re.compile(r"\{\{ names of (?P<folder>\w+) \}\}")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace ``{{ names of FOLDER }}`` by the documentation of every public name that is defined there, and tables."""
    markdown = markdown.replace("{{ table of laws }}", laws_table()).replace("{{ table of advice }}", advice_table())
    return NAMES.sub(_names, markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Replace formulas that the arithmatex extension marked (browsers draw MathML, no script is needed), and roles."""
    return ROLE.sub(_link, FORMULA.sub(_mathml, content))


def laws_table() -> str:
    """Return every law of the registry as a table."""
    rows = [
        f"| `{name}` | {entry.summary} | {entry.source} | {entry.needs} | {', '.join(entry.law.forms)} |"
        for name, entry in CONTROLLERS.items()
    ]
    return "\n".join(["| law | does | from | needs | forms of J̄₂ |", "|---|---|---|---|---|", *rows])


def advice_table() -> str:
    """Return what each failed line of a certificate means as a table."""
    rows = [f"| {name} | {text} |" for name, text in ADVICE.items()]
    return "\n".join(["| line | means |", "|---|---|", *rows])


def _names(match: re.Match[str]) -> str:
    prefix = f"phcontrol.{match['folder']}"
    names = [
        name for name in phcontrol.__all__ if getattr(getattr(phcontrol, name), "__module__", "").startswith(prefix)
    ]
    pages = [f"::: phcontrol.{name}" for name in sorted(names, key=str.lower)]
    if match["folder"] == "controllers":  # laws that are in the registry alone
        public = [getattr(phcontrol, name) for name in names]
        laws = dict.fromkeys(entry.law for entry in CONTROLLERS.values() if entry.law not in public)
        pages += [f"::: {law.__module__}.{law.__qualname__}" for law in laws]
    return "\n\n".join(pages)


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
