"""docs/theory.md and the tests have the same errata, each with the equations that it is about."""

from __future__ import annotations

import re
from pathlib import Path

FOLDER = Path(__file__).parent
THEORY = (FOLDER.parents[2] / "docs" / "theory.md").read_text()
ROW = re.compile(r"^\| (E\d+) \| ([^|]+) \|", re.MULTILINE)
TEST = re.compile(r"^def test_e(\d\d)_\w+\([^)]*\):\n    \"\"\"(.*?)\"\"\"", re.MULTILINE | re.DOTALL)
EQUATION = re.compile(r"\((\d\.\d+)\)")


def in_documentation() -> dict[str, set[str]]:
    """Return the errata of the documentation, and the equations that each names."""
    return {name: set(EQUATION.findall(where)) for name, where in ROW.findall(THEORY)}


def in_tests() -> dict[str, set[str]]:
    """Return the errata that have a test, and the equations that the tests name."""
    found: dict[str, set[str]] = {}
    for path in sorted(FOLDER.glob("test_chapter_*.py")):
        for number, text in TEST.findall(path.read_text()):
            found.setdefault(f"E{int(number)}", set()).update(EQUATION.findall(text))
    return found


def test_each_erratum_has_a_test_and_each_test_an_erratum():
    assert sorted(in_documentation()) == sorted(in_tests())
    assert len(in_documentation()) >= 35


def test_errata_are_listed_once_and_in_order():
    numbers = [int(name[1:]) for name, _ in ROW.findall(THEORY)]
    assert numbers == list(range(1, len(numbers) + 1))


def test_what_a_test_names_is_what_the_list_says():
    """A test may name equations beside, which the printed form is held against, but it names one of its erratum's."""
    without = [name for name, equations in in_documentation().items() if equations and not equations & in_tests()[name]]
    assert without == []
