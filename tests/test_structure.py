"""The package's imports go one way: no module needs itself, not even for type checking."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import phcontrol

PACKAGE = Path(phcontrol.__file__).parent
LAYERS = (
    "mechanics", "potentials", "vision", "trajectories", "setpoints", "environments", "sensors", "tanks",
    "poles", "controllers", "compilation", "safety", "simulation", "runtime", "analysis", "design", "identification",
    "visualization", "sweeps", "runs", "thesis", "cli",
)  # fmt: skip
"""The folders; each imports from itself and from those before it."""


def sources(folder: Path) -> dict[str, str]:
    """Return the text of every module of a package by its name; a package counts as its ``__init__``."""
    texts = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder.parent).with_suffix("").parts
        texts[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path.read_text(encoding="utf-8")
    return texts


def import_graph(texts: dict[str, str]) -> dict[str, set[str]]:
    """Return what each module imports of the others: at its top, in functions and for type checking alike."""
    graph: dict[str, set[str]] = {}
    for module, text in texts.items():
        found = set()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{module}: a relative import"
                named = {f"{node.module}.{alias.name}" for alias in node.names}  # a module, or a name in one
                found |= {name if name in texts else str(node.module) for name in named}
        graph[module] = found & texts.keys()
    return graph


def cycle(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules of a cycle, first to last; none when there is none."""
    done: set[str] = set()

    def search(module: str, way: list[str]) -> list[str]:
        if module in way:
            return [*way[way.index(module) :], module]
        if module in done:
            return []
        for following in sorted(graph[module]):
            found = search(following, [*way, module])
            if found:
                return found
        done.add(module)
        return []

    return next((found for module in sorted(graph) if (found := search(module, []))), [])


def backward(graph: dict[str, set[str]], layers: tuple[str, ...]) -> list[str]:
    """Return the imports that go from a layer to a later one."""

    def layer(module: str) -> int:
        folder = module.split(".")[1] if "." in module else ""
        return layers.index(folder) if folder in layers else -1

    return [
        f"{module} -> {imported}"
        for module, found in graph.items()
        for imported in sorted(found)
        if "." in module and layer(imported) > layer(module)
    ]


GRAPH = import_graph(sources(PACKAGE))


def test_no_module_needs_itself():
    assert len(GRAPH) > 150
    assert sum(map(len, GRAPH.values())) > 500
    assert cycle(GRAPH) == []


def test_every_folder_imports_only_those_before_it():
    folders = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    assert folders - set(LAYERS) == set()
    assert backward(GRAPH, LAYERS) == []


def test_the_thesis_is_needed_by_the_command_line_alone():
    users = {module for module, found in GRAPH.items() if any(".thesis." in name for name in found)}
    assert {module.split(".")[1] for module in users} == {"thesis", "cli"}


@pytest.mark.parametrize(
    "backwards",
    [
        "from house.rooms.kitchen import Kitchen",
        "import house.rooms.kitchen",
        "from house.rooms import kitchen",
        "def cook():\n    from house.rooms.kitchen import Kitchen",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.rooms.kitchen import Kitchen",
    ],
)
def test_a_cycle_is_found_however_it_is_made(backwards):
    texts = {
        "house": "from house.rooms.kitchen import Kitchen",
        "house.rooms": "",
        "house.rooms.kitchen": "from house.garden import herbs\nclass Kitchen: ...",
        "house.garden": "from house.tools import spade",
        "house.tools": "spade = 1",
    }
    assert cycle(import_graph(texts)) == []
    assert backward(import_graph(texts), ("tools", "garden", "rooms")) == []
    graph = import_graph(texts | {"house.tools": backwards})
    found = cycle(graph)
    assert found[0] == found[-1]
    assert set(found) == {"house.rooms.kitchen", "house.garden", "house.tools"}
    assert backward(graph, ("tools", "garden", "rooms")) == ["house.tools -> house.rooms.kitchen"]
