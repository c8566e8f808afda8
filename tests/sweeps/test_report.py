"""A sweep's report on results that are made up: its numbers and maps against what they were made of."""

from __future__ import annotations

import re

import numpy as np
import pyarrow as arrow
import pytest
from matplotlib.collections import QuadMesh

from phcontrol import SweepResults
from phcontrol.sweeps.report import write_report
from phcontrol.sweeps.report_figures import influence, maps_figure, quantiles_figure

UNITS = {"run": "", "load": "kg", "gain": "", "wind": "N"}


def made_up(folder, runs=400, require=None, measures=("depth", "torque"), failed=0):
    """Return results whose measures are large where load and gain are, and do not depend on the wind."""
    rng = np.random.default_rng(4)
    columns = {"run": np.arange(runs), "load": rng.uniform(0.0, 2.0, runs), "gain": rng.integers(1, 4, runs) * 1.0}
    columns |= {"wind": rng.normal(size=runs)}
    for place, name in enumerate(measures):
        columns[name] = (place + 1.0) * (3.0 * columns["load"] + 0.5 * columns["gain"] + 1.0)
        columns[name][:failed] = np.nan
    columns |= {"error": ["gave up"] * failed + [""] * (runs - failed), "compiled": [True] * runs}
    sweep = {
        "law": {"name": "a_law"}, "arm": {"robot": "an_arm"}, "runs": runs, "require": require or {}, "sampling": {},
        "measures": [{"name": name} for name in measures],
    }  # fmt: skip
    manifest = {"columns": dict.fromkeys(columns, "") | UNITS, "sweep": sweep, "phcontrol": "1.0", "hash": "ab" * 32}
    return SweepResults(folder, manifest, arrow.table(columns))


@pytest.mark.parametrize(
    ("require", "shown"), [(None, "depth"), ({"depth": 9.0, "torque": 3.0}, "torque"), ({"torque": 99.0}, "torque")]
)
def test_the_page_says_what_the_results_say(require, shown, tmp_path, monkeypatch):
    monkeypatch.setattr("phcontrol.sweeps.report.save_figure", lambda figure, path: path)
    results = made_up(tmp_path, require=require)
    write_report(results)
    page = (tmp_path / "report.html").read_text()
    assert f"<h2>Where {shown} is large</h2>" in page
    assert (
        re.search(r"<b>(.*) %</b>good at least", page)[1]
        == re.search(r"at least (\S+) %", results.statement().text("are"))[1]
    )
    parts = re.search(r"explain most of it by themselves \((.*?)\)", page)[1].split(", ")
    found = influence(results, shown)
    assert [part.split()[0] for part in parts] == list(found) == ["load", "gain", "wind"]
    assert [int(part.split()[1]) for part in parts] == [round(100.0 * part) for part in found.values()]
    depth = results.column("depth")
    median, largest = np.sort(depth)[199], depth.max()
    assert re.search(rf"<td>depth</td><td></td><td>{median:.4g}</td>.*<td>{largest:.4g}</td>", page)


def test_the_influence_is_the_share_of_the_variance_between_classes(tmp_path):
    """Of ranks, the variance of a function of the load and what is left, by groups of forty."""
    results = made_up(tmp_path)
    ranks = np.argsort(np.argsort(results.column("depth"))) + 1.0
    load = results.column("load")
    classes = np.argsort(np.argsort(load)) // 40
    within = sum(((ranks[classes == k] - ranks[classes == k].mean()) ** 2).sum() for k in range(10)) / (400 - 10)
    assert influence(results, "depth")["load"] == pytest.approx(1.0 - within / np.var(ranks, ddof=1), abs=5e-3)
    assert influence(results, "depth")["wind"] < 0.05


def test_a_field_of_a_map_has_the_largest_of_its_runs(tmp_path):
    results = made_up(tmp_path, failed=7)
    figure = maps_figure(results, "depth")
    meshes = [
        mesh for axes in figure.axes for mesh in axes.collections if isinstance(mesh, QuadMesh) and axes.get_xlabel()
    ]
    assert [(axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes[:3]] == [
        ("load [kg]", "gain"), ("load [kg]", "wind [N]"), ("gain", "wind [N]"),
    ]  # fmt: skip
    kept = slice(7, None)
    depth, load, gain = (results.column(name)[kept] for name in ("depth", "load", "gain"))
    edges = meshes[0].get_coordinates()[0, :, 0]
    table = meshes[0].get_array()
    assert table.shape == (3, len(edges) - 1)
    for row in range(3):  # a field for each gain
        for field in range(len(edges) - 1):
            low = -np.inf if field == 0 else edges[field]
            high = np.inf if field == len(edges) - 2 else edges[field + 1]
            inside = depth[(gain == row + 1) & (load >= low) & (load < high)]
            assert bool(np.ma.getmaskarray(table)[row, field]) == (not len(inside))
            if len(inside):
                assert table[row, field] == inside.max()
    shown = np.concatenate([np.ma.compressed(mesh.get_array()) for mesh in meshes])
    for mesh in meshes:
        assert (mesh.norm.vmin, mesh.norm.vmax) == (shown.min(), shown.max())
    assert np.ma.getmaskarray(meshes[1].get_array()).any()  # no wind in some corner


def test_few_runs_are_points_with_their_value_for_a_colour(tmp_path):
    results = made_up(tmp_path, runs=12)
    figure = maps_figure(results, "depth")
    (points,) = figure.axes[0].collections
    np.testing.assert_array_equal(points.get_array(), results.column("depth"))
    assert (points.norm.vmin, points.norm.vmax) == (results.column("depth").min(), results.column("depth").max())


def test_the_part_above_a_value_is_counted_and_every_picture_has_its_room(tmp_path):
    results = made_up(tmp_path, runs=50, measures=tuple("abcdefg"), require={"b": 9.0})
    figure = quantiles_figure(results)
    assert len(figure.axes) == 7
    assert figure.get_figheight() > 2.0 * 3
    values, above = figure.axes[1].lines[0].get_data()
    np.testing.assert_array_equal(values, np.sort(results.column("b")))
    np.testing.assert_allclose(above, [(results.column("b") >= value).mean() for value in values])
    assert list(figure.axes[1].lines[1].get_xdata()) == [9.0, 9.0]
