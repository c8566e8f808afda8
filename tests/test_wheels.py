"""What wheels are made of and for: all that is compiled, and every Python that is promised."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_wheels_are_made_for_every_python_that_is_promised(project):
    promised = re.findall(r"Python :: (3\.\d+)\b", "\n".join(project["project"]["classifiers"]))
    made = re.findall(r"cp(3)(\d+)-\*", project["tool"]["cibuildwheel"]["build"])
    assert [".".join(version) for version in made] == promised
    assert project["project"]["requires-python"] == f">={promised[0]}"


def test_what_a_wheel_is_tried_with_exists(project):
    wheels = project["tool"]["cibuildwheel"]
    assert set(wheels["test-extras"]) <= set(project["project"]["optional-dependencies"])
    assert all(command.split()[0] in project["project"]["scripts"] for command in wheels["test-command"])


@pytest.mark.parametrize("suffix", [".c", ".h"])
def test_all_sources_and_headers_are_compiled(suffix):
    hook, makefile = ((ROOT / name).read_text(encoding="utf-8") for name in ("hatch_build.py", "Makefile"))
    listed = {"/".join(re.findall(r'"([^"]+)"', parts)) for parts in re.findall(r"    Path\((.+)\),\n", hook)}
    there = {path.relative_to(ROOT).as_posix() for path in (ROOT / "phcontrol").rglob(f"*{suffix}")}
    assert there
    assert there == {name for name in listed if name.endswith(suffix)}
    assert all(name in makefile for name in there)
