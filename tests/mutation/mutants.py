"""Mutation testing: does some test fail when a line is wrong?

    pip install cosmic-ray coverage
    nice -n 15 python tests/mutation/mutants.py --folders vision sensors --sample 120 --out mutants.jsonl
    nice -n 15 python tests/mutation/mutants.py --retry mutants.jsonl       # its survivors again, after new tests
    (the first command again goes on where it was stopped; --tests tests/vision and --cases 2 make a first look shorter)
    python tests/mutation/mutants.py --table mutants.jsonl

The mutants are Cosmic Ray's. Of the ten replacements it has for each operator only the likely slips are used
(+ for −, × for ÷, < for ≤, a sign left out): the others fail on the spot and would flatter the figure.
Annotations are no code and not mutated.

A map, made once and brought up to date at each start, says which tests execute which line (each test by itself, with
empty caches), so that a mutant is tried by those tests only: first those near to it, the fastest first, up to the
first failure. A mutant on a line that no test executes has survived. ``equivalents.toml`` lists mutants that no test
can kill, because they are right too, and says why. With the arms that the tests share loaded, a child is forked for
each mutant and the mutated function put in the place of the right one; what a mutant changes while modules are
imported or arms loaded is tried in a child that imports everything anew.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections import Counter
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import tomllib
from collected import CollectedTests, collect
from fresh import FreshImports
from mutation_source import (
    EqualCodeError,
    change,
    changed_function,
    enclosing,
    function_lines,
    mutants,
    mutated,
    statement,
)

ROOT = Path(__file__).parents[2]
FOLDERS = (*sorted(path.parent.name for path in ROOT.glob("phcontrol/*/__init__.py")), "top")
MAP = ROOT / "results" / "mutation" / "map.json"
EQUIVALENTS = Path(__file__).with_name("equivalents.toml")


def modules(folder: str) -> list[str]:
    """Return a folder's modules; "top" is the modules beside the folders."""
    paths = sorted((ROOT / "phcontrol" / ("" if folder == "top" else folder)).glob("*.py"))
    return [str(path.relative_to(ROOT)) for path in paths if path.name != "_version.py"]


def digest(path: Path) -> str:
    """Return a short hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


class LineMap:
    """Which tests execute which line; kept in a file between runs."""

    def __init__(self, path: Path) -> None:
        self.path = path
        known = json.loads(path.read_text()) if path.is_file() else {"sources": {}, "tests": {}}
        self.tests: dict[str, dict[str, Any]] = known["tests"]
        self.sources: dict[str, str] = known["sources"]
        self.imported: dict[str, list[int]] = {}
        self.imported_by: dict[str, dict[str, set[int]]] = {}
        self.usable: dict[str, dict[str, Any]] = {}

    def update(self, collected: CollectedTests, tree: Path, only: list[str], longest: float) -> None:
        """Record the tests that are new, whose file has changed or that execute a module that has changed."""
        self.imported, self.imported_by = collected.imported, collected.imported_by
        now = {str(path.relative_to(tree)): digest(path) for path in sorted(tree.glob("phcontrol/**/*.py"))}
        changed = {module for module in now.keys() | self.sources.keys() if now.get(module) != self.sources.get(module)}
        hashes = {name: digest(tree / name.split("::")[0]) for name in collected.items}
        kept = {
            name: record
            for name, record in self.tests.items()
            if (name not in collected.items and only != ["tests"])
            or (name in hashes and record["hash"] == hashes[name])
            if record["passed"] and not changed & record["lines"].keys()
        }
        missing = [name for name in collected.items if name not in kept]
        self.tests, self.sources = kept, now
        for number, name in enumerate(missing, start=1):
            print(f"\rmap: {number} of {len(missing)}" if number % 20 == 0 else "", end="", flush=True)
            record = collected.record(name, longest)
            if not record["passed"]:
                print(f"\nnot used, fails by itself or takes too long: {name}")
            kept[name] = {**record, "hash": hashes[name]}
            if number % 25 == 0 or number == len(missing):
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self.path.write_text(json.dumps({"sources": self.sources, "tests": self.tests}))
        print("\r", end="")
        self.usable = {name: kept[name] for name in collected.items if kept[name]["passed"]}

    def executing(self, module: str, lines: set[int]) -> dict[str, float]:
        """Return the tests that execute one of a module's lines, with their times [s]; the best to try come first."""
        found = {
            name: record["seconds"]
            for name, record in self.usable.items()
            if not lines.isdisjoint(record["lines"].get(module, ()))
        }
        return self._sorted(module, found)

    def importing(self, module: str, lines: set[int]) -> dict[str, float]:
        """Return the tests of the files that execute one of a module's lines when they are imported."""
        files = {file for file, executed in self.imported_by.items() if lines & executed.get(module, set())}
        return self._sorted(module, {n: r["seconds"] for n, r in self.usable.items() if n.split("::")[0] in files})

    def starting(self, module: str) -> dict[str, float]:
        """Return the tests that start processes and belong to a module's folder: what they execute is not known."""
        found = {name: r["seconds"] for name, r in self.usable.items() if r["starts"]}
        top = len(Path(module).parts) == 2
        return self._sorted(module, {name: s for name, s in found.items() if top or _is_near(module, name)})

    def looking(self, module: str) -> dict[str, float]:
        """Return the tests that may look at a module's definitions and execute none of its lines.

        They are those of what every definition must be, and those that import the module by its name.
        """
        dotted = _dotted(module)
        seconds = {name: record["seconds"] for name, record in self.usable.items()}
        every = {name: s for name, s in seconds.items() if name.endswith(f"[{dotted}]")}
        return every | self._sorted(module, {n: s for n, s in seconds.items() if _imports(n.split("::")[0], dotted)})

    @staticmethod
    def _sorted(module: str, found: dict[str, float]) -> dict[str, float]:
        own = f"/test_{Path(module).stem.lstrip('_')}.py::"

        def rank(entry: tuple[str, float]) -> tuple[bool, float]:
            test, seconds = entry
            return not _is_near(module, test), seconds / 4.0 if own in test else seconds

        return dict(sorted(found.items(), key=rank))


def _dotted(module: str) -> str:
    return ".".join(Path(module).with_suffix("").parts).removesuffix(".__init__")


def _is_near(module: str, test: str) -> bool:
    """Report whether a test is in the module's folder of tests, or its file imports the module by its name."""
    folder, file = Path(module).parts[1], test.split("::")[0]
    places = f"tests/{folder}/", f"tests/test_{Path(module).stem}.py"
    return file.startswith(places) or _imports(file, _dotted(module))


@cache
def _imports(test_file: str, name: str) -> bool:
    return re.search(rf"\b{re.escape(name)}\b", (ROOT / test_file).read_text()) is not None


def within(budget: float, usual: dict[str, float]) -> dict[str, float]:
    """Return the first tests, up to a sum of times [s], and at least one."""
    times = np.cumsum(list(usual.values()))
    return {name: s for (name, s), time in zip(usual.items(), times, strict=True) if time <= max(budget, times[0])}


@lru_cache(maxsize=1)
def equivalents() -> dict[tuple[str, str, str], str]:
    """Return why mutants are equivalent, by module, the line before and the line after."""
    listed = tomllib.loads(EQUIVALENTS.read_text()).get("equivalent", []) if EQUIVALENTS.is_file() else []
    return {
        (f"phcontrol/{entry['module']}", entry["line"], mutant): entry["why"]
        for entry in listed
        for mutant in entry["mutants"]
    }


def is_equivalent(record: dict[str, Any]) -> bool:
    """Report whether a mutant is the same program, or listed as one that is right too."""
    return record["outcome"] == "same" or (record["module"], *record["change"]) in equivalents()


def try_mutant(
    mutant: dict[str, Any], lines: LineMap, collected: CollectedTests, fresh: FreshImports, budget: float
) -> dict[str, Any]:
    """Return the mutant with what became of it: killed (by which test), survived, unreached or same."""
    module = mutant["module"]
    source = (fresh.tree / module).read_text()
    text = mutated(source, mutant["operator"], mutant["occurrence"])
    assert text is not None
    record = {**mutant, "change": change(source, text), "outcome": "survived", "by": ""}
    try:
        function = changed_function(source, text)
    except EqualCodeError:
        return record | {"outcome": "same"}
    span = set(statement(source, mutant["line"]))
    status, by, reached = 0, "", False
    if function and collected.has(module, function[0]):
        executing = within(budget, lines.executing(module, span))
        reached, usual = bool(executing), {}
        if executing and span & set(collected.warmed.get(module, ())):
            usual = executing
        elif executing:
            status, by = collected.run(module, *function, executing)
        if status == 0 and span & set(lines.imported.get(module, ())):
            usual = within(budget, lines.executing(module, span | (set(enclosing(source, mutant["line"])))))
            usual |= within(
                budget, lines.executing(module, function_lines(source))
            )  # objects that modules of tests made
            usual |= within(budget, lines.looking(module))
    else:
        inside = set(enclosing(source, mutant["line"]))
        usual = lines.executing(module, inside & function_lines(source))
        usual = within(budget, usual or lines.executing(module, function_lines(source) or inside))
        usual = within(budget, lines.looking(module)) | usual
    if status == 0:
        usual |= within(budget, lines.starting(module))
        if usual:
            reached = True
            status, by = fresh.run(module, text, usual)
    outcome = "killed" if status not in (0, 5) else "survived" if reached else "unreached"
    return record | {"outcome": outcome, "by": by or (f"exit {status}" if outcome == "killed" else "")}


def place(mutant: dict[str, Any]) -> tuple[str, str, int]:
    """Return what tells a mutant from the others."""
    return mutant["module"], mutant["operator"], mutant["occurrence"]


def again(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return survivors' mutants as they are in the present source; those whose line is gone are left out."""
    found = []
    for record in records:
        source = (ROOT / record["module"]).read_text()
        for mutant in sorted(
            (m for m in mutants(ROOT, record["module"]) if m["operator"] == record["operator"]),
            key=lambda m: abs(m["occurrence"] - record["occurrence"]),
        ):
            text = mutated(source, mutant["operator"], mutant["occurrence"])
            if text is not None and change(source, text) == record["change"]:
                found.append({**record, **mutant, "first": record.get("first", record["outcome"])})
                break
        else:
            print(f"gone: {record['module']}: {record['change'][1]}")
    return found


def table(records: list[dict[str, Any]]) -> str:
    """Return the figures: per folder the mutants tried, killed first and now, and equivalents."""
    rows = ["folder          tried  killed first   killed now  equivalent  killed of the others"]
    for folder in sorted({record["folder"] for record in records}):
        mine = [record for record in records if record["folder"] == folder]
        first = sum(record.get("first", record["outcome"]) == "killed" for record in mine)
        now = Counter(record["outcome"] for record in mine)["killed"]
        same = sum(is_equivalent(record) and record["outcome"] != "killed" for record in mine)
        shares = f"{first:4d} ({first / len(mine):4.0%})  {now:4d} ({now / len(mine):4.0%})"
        rows.append(f"{folder:15s} {len(mine):5d}   {shares}  {same:10d}  {now / max(1, len(mine) - same):7.1%}")
    wrong = [r for r in records if r["outcome"] == "killed" and (r["module"], *r["change"]) in equivalents()]
    rows += [f"listed as equivalent, but killed: {r['module']}: {r['change'][1]}" for r in wrong]
    return "\n".join(rows)


def survivors(records: list[dict[str, Any]]) -> str:
    """Return the survivors that are not listed as equivalent."""
    rows = []
    for r in sorted(records, key=lambda r: (r["module"], r["line"])):
        if r["outcome"] != "killed" and not is_equivalent(r):
            rows.append(f"{r['module']}:{r['line']} {r['outcome']}\n  - {r['change'][0]}\n  + {r['change'][1]}")
    return "\n".join(rows)


def main() -> None:
    """Try sampled mutants, or the survivors of an earlier run, and print the share killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folders", nargs="+", choices=FOLDERS, default=list(FOLDERS))
    parser.add_argument("--sample", type=int, default=0, help="how many mutants of each folder; 0 for all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="part of a module's path")
    parser.add_argument("--skip", nargs="*", default=[], help="parts of the paths of modules to leave out")
    parser.add_argument("--tests", nargs="+", default=["tests"], help="test files and folders to use")
    parser.add_argument("--cases", type=int, default=0, help="how many cases of a parametrised test at most; 0 for all")
    parser.add_argument("--longest", type=float, default=300.0, help="processor time [s] from which a test is not used")
    parser.add_argument("--budget", type=float, default=10.0, help="usual time [s] of the tests that try one mutant")
    parser.add_argument("--map", type=Path, default=MAP, help="where the map of executed lines is kept")
    parser.add_argument("--out", type=Path, default=MAP.with_name("mutants.jsonl"))
    parser.add_argument("--retry", type=Path, help="a file of results: try its survivors again and rewrite it")
    parser.add_argument("--table", type=Path, nargs="+", help="files of results: print their figures and survivors")
    options = parser.parse_args()
    options.map, options.out = options.map.resolve(), options.out.resolve()
    if options.table:
        records = [json.loads(line) for path in options.table for line in path.read_text().splitlines()]
        print(survivors(records), table(records), sep="\n")
        return
    done: list[dict[str, Any]] = []
    chosen: list[dict[str, Any]] = []
    if options.retry:
        options.out = options.retry.resolve()
        records = [json.loads(line) for line in options.out.read_text().splitlines()]
        open_ = [r for r in records if r["outcome"] in ("survived", "unreached") and not is_equivalent(r)]
        done = [r for r in records if r not in open_]
        chosen = again(open_)
    else:
        for folder in options.folders:
            named = [m for m in modules(folder) if options.only in m and not any(s in m for s in options.skip)]
            everything = [{**mutant, "folder": folder} for module in named for mutant in mutants(ROOT, module)]
            order = np.random.default_rng(options.seed).permutation(len(everything))[: options.sample or None]
            chosen += [everything[i] for i in sorted(order)]
            print(f"{folder}: {len(everything)} mutants, {len(order)} tried")
        if options.out.is_file():  # go on where an earlier run was stopped
            keys = {place(mutant) for mutant in chosen}
            done = [r for r in map(json.loads, options.out.read_text().splitlines()) if place(r) in keys]
            chosen = [mutant for mutant in chosen if place(mutant) not in {place(record) for record in done}]
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve() / "tree"
        ignore = shutil.ignore_patterns(".git", ".venv", "__pycache__", "results", ".hypothesis", "site")
        shutil.copytree(ROOT, tree, ignore=ignore)
        lines, fresh = LineMap(options.map), FreshImports(tree)

        def work(collected: CollectedTests) -> None:
            lines.update(collected, tree, options.tests, options.longest)
            collected.warm_up()
            options.out.parent.mkdir(parents=True, exist_ok=True)
            for number, mutant in enumerate(chosen, start=1):
                done.append(try_mutant(mutant, lines, collected, fresh, options.budget))
                untried = chosen[number:] if options.retry else []
                options.out.write_text("".join(json.dumps(record) + "\n" for record in done + untried))
                print(f"\r{number} of {len(chosen)}", end="", flush=True)
            print()

        code = collect(tree, options.tests, work, options.cases)
        fresh.close()
        os.chdir(ROOT)
        assert code == 0, f"pytest ended with {code}"
    print(survivors(done), table(done), sep="\n")


if __name__ == "__main__":
    main()
