"""What is left to ``make test-all``: the list of it, and how it is chosen."""

from __future__ import annotations

from pathlib import Path

from tests.costs import listed, long_cases

ROOT = Path(__file__).parents[1]


def test_the_cases_that_are_left_out_are_of_tests_that_exist():
    for case in listed():
        file, _, name = case.partition("[")[0].partition("::")
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8")


def test_the_longest_cases_are_left_out_and_the_quickest_of_each_test_stays_as_long_as_there_is_room():
    costs = {"a::x[0]": 5.0, "a::x[1]": 1.0, "a::y": 2.5, "a::z": 9.0, "b::w[0]": 0.1, "b::w[1]": 0.2, "b::s": 7.0}
    lines = [{"case": case, "wall": cost, "study": case == "b::s"} for case, cost in costs.items()]
    assert long_cases(lines, 100.0, "wall") == []
    assert long_cases(lines, 13.0, "wall") == ["a::x[0]"]
    assert long_cases(lines, 5.0, "wall") == ["a::x[0]", "a::z"]
    assert long_cases(lines, 0.0, "wall") == ["a::x[0]", "a::z", "a::y", "a::x[1]", "b::w[1]", "b::w[0]"]
