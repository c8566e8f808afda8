"""What the README and the documentation print runs as printed, and their links lead somewhere."""

from __future__ import annotations

import importlib.util
import re
import shlex
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from phcontrol.cli import app
from phcontrol.compilation.compiler import find_compiler
from phcontrol.controllers.registry import CONTROLLERS

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
TUTORIAL = ROOT / "docs" / "tutorial.md"
CAMERA = ROOT / "docs" / "camera-to-grasp.md"
OWN_LAW = ROOT / "docs" / "own-law.md"
SEPARATE = [page for page in PAGES if page not in (TUTORIAL, OWN_LAW, CAMERA)]
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


LAW = re.compile(r"`([a-z_]+)`")


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_python_snippets_run(snippet, tmp_path, monkeypatch):
    if "compile_law" in snippet and find_compiler() is None:
        pytest.skip("no C compiler: laws cannot be compiled here")
    monkeypatch.setenv("PHCONTROL_CACHE", str(tmp_path / "cache"))
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
    assert Path("run.html").stat().st_size > 250_000  # the 3-D library alone
    assert Path("position.html").exists()


def test_the_page_on_cameras_runs_from_top_to_bottom(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {"__name__": "__main__"}
    for block in re.findall(r"```python\n(.*?)```", CAMERA.read_text(), re.DOTALL):
        exec(compile(block, "camera", "exec"), namespace)
    said = capsys.readouterr().out
    quoted = " ".join(re.findall(r"\*(STOPPED.*?)\*", CAMERA.read_text(), re.DOTALL)[0].split())
    assert quoted in said
    assert "wait -> reach (touched)" in said
    assert "reach -> there (settled)" in said
    assert abs(namespace["thing"].features(namespace["system"].at(namespace["box"].reading().position))
               - namespace["servo"].goal).max() < 1e-4  # fmt: skip


@pytest.mark.study
def test_the_command_of_the_page_on_cameras_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (command,) = re.findall(r"```sh\nphcontrol (.*?)#", CAMERA.read_text())
    result = CliRunner().invoke(app, shlex.split(command))
    assert result.exit_code == 0, result.output


def test_the_page_on_ones_own_law_runs_from_top_to_bottom(tmp_path, monkeypatch):
    """Blocks with a title are written to that file, one after another."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "my_laws", raising=False)
    monkeypatch.setattr("phcontrol.controllers.registry.CONTROLLERS", CONTROLLERS.copy())
    count = 0
    for language, title, block in re.findall(
        r"```(python|sh)(?: title=\"(.*?)\")?\n(.*?)```", OWN_LAW.read_text(), re.DOTALL
    ):
        count += 1
        if title:
            with Path(title).open("a") as file:
                file.write(block + "\n\n")
            sys.modules.pop("my_laws", None)
        elif language == "python":
            exec(compile(block, "own-law", "exec"), {"__name__": "__main__"})
        else:
            for line in block.splitlines():
                result = CliRunner().invoke(app, shlex.split(line)[1:])
                assert result.exit_code == 0, result.output
    assert count == 7
    monkeypatch.delitem(sys.modules, "my_laws")


def test_laws_that_the_documentation_names_exist_as_it_says():
    """Its tables may leave laws out, which ``phcontrol controllers`` lists, but not name others."""
    text = (ROOT / "README.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \|", text.split("## Controllers")[1].split("##")[0], re.MULTILINE)
    assert len(rows) > 5
    assert [name for name in rows if name not in CONTROLLERS] == []
    choosing = (ROOT / "docs" / "choosing-a-controller.md").read_text().split("## Gains")[0]
    named = [name for row in re.findall(r"^\|[^|]+\|([^|]+)\|", choosing, re.MULTILINE) for name in LAW.findall(row)]
    assert len(named) > 5
    assert [name for name in named if name not in CONTROLLERS] == []


def test_what_once_passed_is_held_by_tests_that_are_there():
    rows = [row for row in (ROOT / "docs" / "red-team.md").read_text().splitlines() if "::" in row]
    named = [re.fullmatch(r".*`(tests/[\w/]+\.py)::(test_\w+)` \|", row) for row in rows]
    assert all(named)
    assert len(named) > 40
    missing = [name[0] for name in named if f"def {name[2]}(" not in (ROOT / name[1]).read_text()]
    assert missing == []


def test_the_site_lists_every_law_and_every_line_of_a_certificate():
    from phcontrol.analysis.advice import ADVICE

    spec = importlib.util.spec_from_file_location("hooks", ROOT / "docs" / "hooks.py")
    hooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hooks)
    laws = hooks.on_page_markdown((ROOT / "docs" / "api" / "controllers.md").read_text())
    assert [name for name in CONTROLLERS if f"| `{name}` |" not in laws] == []
    assert [entry.law for entry in CONTROLLERS.values() if f".{entry.law.__name__}\n" not in laws + "\n"] == []
    advice = hooks.on_page_markdown((ROOT / "docs" / "choosing-a-controller.md").read_text())
    assert [name for name in ADVICE if f"| {name} |" not in advice] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+?)\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def test_pages_that_the_code_cites_exist():
    """A page by its name; the sections of no page have numbers."""
    for file in sorted((ROOT / "phcontrol").rglob("*.py")):
        text = file.read_text()
        assert not re.search(r"theory sections? [0-9]", text), file
        for page in re.findall(r"docs/[a-z-]+\.md", text):
            assert (ROOT / page).is_file(), f"{file} cites {page}"
