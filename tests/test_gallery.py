"""The gallery and the notebooks: made by what stands beside them, small, complete, and still running."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

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


def film(path):
    """Return the frames of a moving picture, small, and how long each is shown [ms]."""
    with Image.open(path) as picture:
        frames, lasting = [], []
        for number in range(picture.n_frames):
            picture.seek(number)
            frames.append(np.asarray(picture.convert("L").resize((160, 90)), dtype=float))
            lasting.append(picture.info["duration"])
    return frames, lasting


def test_the_moving_picture_moves_and_is_on_both_first_screens():
    path = DOCS / "wiping.webp"
    assert path.stat().st_size <= 2_000_000
    frames, lasting = film(path)
    assert len(frames) > 50
    assert sum(lasting) == pytest.approx(1000 * script("moving_picture").LASTS, rel=0.02)
    arm = [frame[5:80, 60:] for frame in frames]  # right of the panel, above the timeline
    still = [k for k in range(5, 95) if np.abs(arm[k] - arm[k + 2]).max() < 10.0]
    assert still == []
    for page, link in ((DOCS.parent / "README.md", "docs/wiping.webp"), (DOCS / "index.md", "wiping.webp")):
        first_screen = page.read_text()[:2500]
        assert f'<img src="{link}" alt="' in first_screen
        assert "python docs/moving_picture.py" in first_screen


@pytest.mark.study
@pytest.mark.browser
@pytest.mark.usefixtures("browser")
def test_the_moving_picture_can_be_made_again(tmp_path):
    path = tmp_path / "again.webp"
    command = [sys.executable, str(DOCS / "moving_picture.py"), str(path), "--frames", "4"]
    subprocess.run(command, check=True, timeout=900)  # with a browser of its own
    frames, lasting = film(path)
    assert lasting == [2000] * 4
    kept = film(DOCS / "wiping.webp")[0]
    for number, frame in enumerate(frames):  # of the same run, on the same page
        assert np.abs(frame - kept[25 * number]).mean() < 1.0
        assert np.abs(frame - kept[(25 * number + 15) % 100]).mean() > 3.0


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
