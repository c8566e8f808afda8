"""What the README and the documentation print runs as printed, and their links lead somewhere."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from phcontrol.cli import app
from phcontrol.controllers.registry import CONTROLLERS

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
TUTORIAL = ROOT / "docs" / "tutorial.md"
SEPARATE = [page for page in PAGES if page != TUTORIAL]
SNIPPETS = [
    pytest.param(snippet, id=f"{page.name}-{number}")
    for page in SEPARATE
    for number, snippet in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL))
]
COMMANDS = [
    line.split("#")[0].strip()
    for page in SEPARATE
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(), re.DOTALL)
    for line in block.splitlines()
    if line.startswith("phcontrol ")
]


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_python_snippets_run(snippet, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(snippet, "snippet", "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_run(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    assert result.exit_code == 0, result.output


def test_the_tutorial_runs_from_top_to_bottom(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = TUTORIAL.read_text()
    (description,) = re.findall(r"```xml\n(.*?)```", text, re.DOTALL)
    Path("my_arm.urdf").write_text(description)
    namespace: dict[str, object] = {"__name__": "__main__"}
    for language, block in re.findall(r"```(python|sh)\n(.*?)```", text, re.DOTALL):
        if language == "python":
            exec(compile(block, "tutorial", "exec"), namespace)
            continue
        for line in block.splitlines():
            result = CliRunner().invoke(app, shlex.split(line)[1:])
            assert result.exit_code == 0, result.output
    assert Path("run.html").stat().st_size > 500_000
    assert Path("position.html").exists()


def test_every_law_is_in_the_readme():
    text = (ROOT / "README.md").read_text()
    assert [name for name in CONTROLLERS if f"`{name}`" not in text] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+?)\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target
