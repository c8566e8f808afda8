"""What is said of the package agrees: version, changelog, classifiers, extras, and what an installation takes."""

from __future__ import annotations

import json
import re
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from typer.testing import CliRunner

from phcontrol import __version__
from phcontrol.cli import app
from phcontrol.cli.installed_size import sizes_of

try:
    import tomllib
except ImportError:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_version_is_the_same_everywhere():
    dated = re.findall(r"^## \[([\d.]+)\] - (\d{4}-\d{2}-\d{2})$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    citation = (ROOT / "CITATION.cff").read_text()
    assert dated[0][0] == __version__
    assert f"\nversion: {__version__}\ndate-released: {dated[0][1]}\n" in citation
    assert f"version = {{{__version__}}}" in (ROOT / "README.md").read_text()


def test_the_changelog_has_each_heading_once_a_version_and_unreleased_on_top():
    versions = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)[1:]
    assert versions[0].startswith("[Unreleased]")
    for version in versions[1:]:
        headings = re.findall(r"^### (.*)$", version, re.MULTILINE)
        assert len(set(headings)) == len(headings), headings
        assert set(headings) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_every_extra_is_in_the_table_of_the_install_page():
    table = (ROOT / "docs" / "install.md").read_text().split("## Extras")[1].split("\n## ")[0]
    named = {name for row in re.findall(r"^\|([^|]+)\|", table, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)}
    assert named == PROJECT["optional-dependencies"].keys()


def test_a_classifier_names_every_python_from_the_oldest():
    minors = [int(text) for text in re.findall(r"Python :: 3\.(\d+)", "\n".join(PROJECT["classifiers"]))]
    assert f">=3.{minors[0]}" == PROJECT["requires-python"]
    assert minors == list(range(minors[0], minors[-1] + 1))


def test_sizes_are_those_of_the_files_and_leave_no_package_out():
    sizes = sizes_of("phcontrol")
    needed = [Requirement(text) for text in metadata.requires("phcontrol") or []]
    names = {canonicalize_name(item.name) for item in needed if not item.marker or item.marker.evaluate({"extra": ""})}
    assert len(names) > 10
    assert names <= sizes.keys()
    assert canonicalize_name("networkx") in sizes  # of the extra of trimesh that yourdfpy asks for
    assert "pytest" not in sizes  # of an extra of ours
    folder = Path(str(metadata.distribution("trimesh").locate_file("trimesh")))
    there = sum(path.stat().st_size for path in folder.rglob("*.py"))
    assert there <= sizes["trimesh"] <= 3 * there + 2_000_000


def test_the_doctor_says_sizes():
    result = CliRunner().invoke(app, ["doctor", "--sizes"])
    assert result.exit_code == 0
    total = sum(sizes_of("phcontrol").values())
    assert f"{total / 1e6:.1f} MB  all {len(sizes_of('phcontrol'))} packages" in result.stdout
    listed = json.loads(CliRunner().invoke(app, ["doctor", "--sizes", "--json"]).stdout)
    assert sum(listed.values()) == total
    assert sum(float(line) for line in re.findall(r"^ *([\d.]+) MB  (?!all)", result.stdout, re.MULTILINE)) == (
        pytest.approx(total / 1e6, abs=3.0)
    )
