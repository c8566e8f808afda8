"""What each test costs, and which cases ``make test`` leaves to ``make test-all`` for it.

    make test-all COSTS=costs.jsonl            # one line a case: wall and processor seconds
    python -m tests.costs costs.jsonl          # writes tests/long_cases.txt

Cases in that list are marked ``study``. The longest are left out first; the quickest of each test counts as much
shorter than it is, so that what is swept over arms, laws and forms is still seen for one of them.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

LONG = Path(__file__).with_name("long_cases.txt")
BUDGET = 100.0  # of both processors for all that stays [s]: two and a half minutes with all else, on a slow day too
QUICKEST = 0.2  # as what share of its cost the quickest case of a test counts


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--costs", help="file to which a line for each case is added: what it took")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    long = listed()
    for item in items:
        if item.nodeid in long:
            item.add_marker(pytest.mark.study)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    place = item.config.getoption("--costs")
    if not place:
        return (yield)
    study = item.get_closest_marker("study") is not None
    wall, processor = time.perf_counter(), _processor_time()
    try:
        return (yield)
    finally:
        took = {"wall": time.perf_counter() - wall, "processor": _processor_time() - processor}
        line = json.dumps({"case": item.nodeid, "study": study} | took)
        with Path(place).open("a", encoding="utf-8") as file:
            file.write(line + "\n")


def listed() -> set[str]:
    """Return the cases that are left out."""
    return set(LONG.read_text(encoding="utf-8").splitlines()) if LONG.is_file() else set()


def _processor_time() -> float:
    """Return what this process and those that it waited for have taken [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def long_cases(lines: list[dict[str, object]], budget: float, measure: str) -> list[str]:
    """Return the cases to leave out, the longest first, so that the rest takes no more than the budget [s]."""
    already = listed()
    costs = {
        str(line["case"]): float(str(line[measure])) for line in lines if not line["study"] or line["case"] in already
    }
    of_test: dict[str, list[str]] = defaultdict(list)
    for case in costs:
        of_test[case.partition("[")[0]].append(case)
    quickest = {min(cases, key=costs.__getitem__) for cases in of_test.values()}
    total, left_out = sum(costs.values()), []
    weighed = {case: cost * (QUICKEST if case in quickest else 1.0) for case, cost in costs.items()}
    for case in sorted(costs, key=weighed.__getitem__, reverse=True):
        if total <= budget:
            break
        left_out.append(case)
        total -= costs[case]
    print(f"{len(costs) - len(left_out)} cases stay, with {total:.0f} s; {len(left_out)} are left to make test-all")
    return left_out


def main() -> None:
    """Write which cases take too long."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("costs", type=Path)
    parser.add_argument("--budget", type=float, default=BUDGET)
    parser.add_argument("--measure", choices=("wall", "processor"), default="wall")
    options = parser.parse_args()
    lines = [json.loads(line) for line in options.costs.read_text(encoding="utf-8").splitlines()]
    LONG.write_text("\n".join(sorted(long_cases(lines, options.budget, options.measure))) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
