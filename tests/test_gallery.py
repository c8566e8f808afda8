"""The gallery and the notebooks: made by what stands beside them, small, complete, and still running."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from tests.notebooks import execute

DOCS = Path(__file__).parents[1] / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))


def script(name):
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


GALLERY = script("gallery")


def test_every_picture_is_there_and_all_are_small():
    kept = {path.stem: path.stat().st_size for path in (DOCS / "gallery").glob("*.png")}
    assert kept.keys() == GALLERY.PICTURES.keys()
    assert len(kept) >= 16
    assert sum(kept.values()) < 2.5e6
    assert all((make.__doc__ or "").endswith(".") for make in GALLERY.PICTURES.values())


def test_the_page_shows_each_with_its_code():
    page = script("hooks").on_page_markdown((DOCS / "gallery.md").read_text())
    for name, make in GALLERY.PICTURES.items():
        assert f"](gallery/{name}.png)" in page
        assert make.__doc__ in page
    assert page.count("```python") == len(GALLERY.PICTURES) + 1
    for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        compile(code.replace("return ", "found = "), "gallery", "exec")  # its own lines, as they can be copied


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=pytest.mark.study) if name not in ("energies", "compared") else name
    for name in GALLERY.PICTURES
])  # fmt: skip
def test_a_picture_can_be_made_again(name):
    figure = GALLERY.PICTURES[name]()
    drawn = sum(len(axes.lines) + len(axes.images) for axes in figure.axes)
    assert drawn > 0
    for axes in figure.axes:
        for line in axes.lines:
            assert np.isfinite(np.asarray(line.get_ydata(), dtype=float)).any(), (name, axes.get_title())
    plt.close(figure)


def test_notebooks_are_as_their_script_writes_them():
    made = script("make_notebooks")
    assert {path.stem for path in NOTEBOOKS} == made.NOTEBOOKS.keys()
    for path in NOTEBOOKS:
        assert path.read_text() == made.notebook(made.NOTEBOOKS[path.stem])
        assert all(cell.get("outputs", []) == [] for cell in json.loads(path.read_text())["cells"])


SAID = {
    "first-arm": ["PASSED"],
    "own-law": ["PASSED", "FAILED"],
    "cartesian-impedance": ["PASSED", "-20."],  # [mm]: 4 N over 200 N/m
    "certificate": ["PASSED", "'FAILED'"],
}


@pytest.mark.study
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_from_top_to_bottom(path, tmp_path):
    said = execute(path, tmp_path)
    for text in SAID[path.stem]:
        assert text in said
    if path.stem == "certificate":
        (difference,) = re.findall(r"^np\.float64\((\S+)\)$", said, re.MULTILINE)
        assert float(difference) < 1e-6  # between the true rate and the promised one
