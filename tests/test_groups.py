"""Public names by subject: each in one group, the same object, and loaded with its first use."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import phcontrol
from phcontrol import _groups
from phcontrol._groups import GROUPS, WRITTEN, module_of, names_of, stub_of

PACKAGE = Path(phcontrol.__file__).parent


def test_every_public_name_is_in_one_group():
    listed = [name for group in GROUPS for name in names_of(group)]
    assert sorted(listed) == sorted(set(phcontrol.__all__) - {"__version__"})


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_has_the_same_objects_as_the_package(group):
    module = importlib.import_module(f"phcontrol.{group}")
    assert len(names_of(group)) >= 3
    for name in names_of(group):
        assert getattr(module, name) is getattr(phcontrol, name)
    assert set(names_of(group)) == {name for name in module.__all__ if name in phcontrol.__all__}


@pytest.mark.parametrize("group", WRITTEN)
def test_the_files_of_groups_are_as_written(group):
    """After a public name was added: ``python -m phcontrol._groups``."""
    assert (PACKAGE / f"{group}.pyi").read_text() == stub_of(group)
    assert (PACKAGE / f"{group}.py").read_text() == module_of(group)


def test_a_name_that_is_not_in_a_group_is_no_attribute():
    with pytest.raises(AttributeError, match="simulate"):
        importlib.import_module("phcontrol.laws").simulate  # noqa: B018


def test_groups_load_nothing_before_it_is_used():
    names = ", ".join(f"phcontrol.{group}" for group in WRITTEN)
    program = (
        f"import sys, phcontrol, {names}\n"
        "heavy = ('numpy', 'pinocchio', 'scipy', 'matplotlib', 'typer')\n"
        "print([name for name in heavy if name in sys.modules])\n"
        "phcontrol.laws.EnergyShaping\n"
        "print('numpy' in sys.modules)\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines() == ["[]", "True"]


def test_writing_them_again_changes_nothing(tmp_path, monkeypatch):
    (tmp_path / "__init__.pyi").write_text((PACKAGE / "__init__.pyi").read_text())
    monkeypatch.setattr(_groups, "_HERE", tmp_path)
    _groups.write()
    for path in tmp_path.glob("*.py*"):
        assert path.read_text() == (PACKAGE / path.name).read_text()
