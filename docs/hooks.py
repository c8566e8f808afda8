"""What the site's build does beside MkDocs: formulas become MathML, and API pages list every public name."""

from __future__ import annotations

import ast
import html
import re
import textwrap
from pathlib import Path
from typing import Any

import typer
from latex2mathml.converter import convert
from mkdocs.plugins import event_priority

import phcontrol
from phcontrol._groups import GROUPS, names_of
from phcontrol.analysis.advice import ADVICE
from phcontrol.cli import app
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.sweeps.measure import MEASURES
from phcontrol.sweeps.variable import VARIABLES

HERE = Path(__file__).parent
FORMULA = re.compile(r'<(?P<tag>div|span) class="arithmatex">\\[\[(](?P<formula>.*?)\\[\])]</(?P=tag)>', re.DOTALL)
ROLE = re.compile(r":(?:class|func|meth):<code>(?P<name>[\w.]+)</code>")
CARTESIAN = ("cartesian_impedance", "cartesian_tracking")
BUNDLE = re.compile(r'<script src="(?P<root>[^"]*)assets/javascripts/bundle')
NAMES = re.compile(r"\{\{ names of (?P<folder>\w+) \}\}")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace ``{{ names of FOLDER }}`` by the documentation of every public name that is defined there, and tables."""
    made = {
        "{{ table of laws }}": laws_table,
        "{{ table of advice }}": advice_table,
        "{{ table of variables }}": variables_table,
        "{{ table of measures }}": measures_table,
        "{{ command line }}": command_line,
        "{{ groups }}": groups,
        "{{ gallery }}": gallery,
    }
    for mark, make in made.items():
        if mark in markdown:
            markdown = markdown.replace(mark, make())
    return NAMES.sub(_names, markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Replace formulas that the arithmatex extension marked (browsers draw MathML, no script is needed), and roles."""
    return ROLE.sub(_link, FORMULA.sub(_mathml, content))


def on_post_page(output: str, **_: Any) -> str:
    """Return a page that can be searched from a folder, too."""
    return BUNDLE.sub(r'<script src="\g<root>folder-search.js"></script>\g<0>', output)


@event_priority(-100)  # when the index is there
def on_post_build(config: Any, **_: Any) -> None:
    """Write the index as a script: a page that was opened from a folder may read no other file."""
    index = Path(config.site_dir) / "search" / "search_index.json"
    if index.is_file():
        index.with_suffix(".js").write_text(f"var __index = {index.read_text(encoding='utf-8')}\n", encoding="utf-8")


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


def gallery() -> str:
    """Return every picture with its caption and the code that made it."""
    source = (HERE / "gallery.py").read_text(encoding="utf-8")
    parts = []
    for node in ast.parse(source).body:
        if not isinstance(node, ast.FunctionDef) or not (HERE / "gallery" / f"{node.name}.png").is_file():
            continue
        lines = source.splitlines()[node.body[1].lineno - 1 : node.end_lineno]
        code, caption = textwrap.dedent("\n".join(lines)), ast.get_docstring(node)
        title = node.name.replace("_", " ").capitalize()
        picture = f"![{caption}](gallery/{node.name}.png)"
        parts.append(f"## {title}\n\n{caption}\n\n{picture}\n\n```python\n{code}\n```")
    return "\n\n".join(parts)


def groups() -> str:
    """Return every group of public names, with what it holds."""
    rows = [
        f"| `phcontrol.{name}` | {group.summary} | {', '.join(f'`{item}`' for item in names_of(name))} |"
        for name, group in GROUPS.items()
    ]
    return "\n".join(["| group | about | names |", "|---|---|---|", *rows])


def variables_table() -> str:
    """Return what a sweep can vary as a table."""
    rows = [
        f"| `{name}{'.JOINT' if one.of_joint else ''}` | {one.unit} | {one.meaning} |"
        for name, one in VARIABLES.items()
    ]
    rows += ["| `gain.NAME` | of the law | a gain of the law |", "| `gain_factor.NAME` | | a factor of it |"]
    return "\n".join(["| name | unit | is |", "|---|---|---|", *rows])


def measures_table() -> str:
    """Return the measures of a sweep that have a name as a table."""
    rows = [f"| `{name}` | {one.unit} | {one.meaning} |" for name, one in MEASURES.items()]
    return "\n".join(["| name | unit | is |", "|---|---|---|", *rows])


def command_line() -> str:
    """Return the help of every command, made from the commands themselves."""
    commands = typer.main.get_command(app).commands
    runs = commands["run"].commands
    pages = [_help("phcontrol", typer.main.get_command(app))]
    pages += [_help(f"phcontrol {name}", command) for name, command in commands.items()]
    shown = [name for name in runs if name in ("position", "track", "servo", "pick", *CARTESIAN)]
    return "\n\n".join([*pages, *(_help(f"phcontrol run {name}", runs[name]) for name in shown)])


def _help(name: str, command: Any) -> str:
    context = command.context_class(command, info_name=name, **command.context_settings | {"terminal_width": 80})
    return f"## `{name}`\n\n```text\n{command.get_help(context)}\n```"


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
