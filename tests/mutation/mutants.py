"""Mutation testing of mechanics/ and controllers/ (and safety/): does some test fail when a line is wrong?

    pip install cosmic-ray
    nice -n 19 python tests/mutation/mutants.py --sample 600 --seed 0 --out mutants.jsonl

The mutants are Cosmic Ray's. Of the ten replacements it has for each operator only the likely slips are used
(+ for −, × for ÷, < for ≤, a sign left out): the others fail on the spot and would flatter the figure.
Annotations are no code and not mutated. Each mutant is tried in a copy of the tree by a process forked from one that
has the libraries loaded; the tests nearest to the mutated module come first, and the first failure kills.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import json
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
FOLDERS = ("mechanics", "controllers", "safety")
SLIPS = {
    "Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul",
    "Lt_LtE", "Lt_Gt", "LtE_Lt", "LtE_GtE", "Gt_GtE", "Gt_Lt", "GtE_Gt", "GtE_LtE", "Eq_NotEq", "NotEq_Eq", "Is_IsNot",
    "IsNot_Is", "Delete_USub", "Delete_Not",
}  # fmt: skip
PYTEST = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", "ignore::pytest.PytestAssertRewriteWarning"]
TIMEOUT = 180  # [s]
TESTS = {
    "mechanics": ["tests/mechanics", "tests/analysis/test_certificate.py", "tests/controllers"],
    "controllers": ["tests/controllers", "tests/analysis/test_certificate.py"],
    "safety": ["tests/safety"],
}
WIDE = ["tests/simulation", "tests/safety", "tests/environments", "tests/analysis", "tests/test_cli.py"]


def mutants(root: Path, folders: tuple[str, ...]) -> list[dict[str, Any]]:
    """List every mutant in some folders: module, operator, occurrence and place."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    found = []
    for folder in folders:
        for path in sorted((root / "phcontrol" / folder).glob("*.py")):
            source = path.read_text()
            tree, silent = get_ast(source), annotations(source)
            for name in sorted(operator_names()):
                if "Operator_" in name and name.split("Operator_")[1] not in SLIPS:
                    continue
                operator_class = get_operator(name)
                if operator_class.arguments():
                    continue  # needs to be told what to replace by what
                operator = operator_class()
                places = [place for node in ast_nodes(tree) for place in operator.mutation_positions(node)]
                for occurrence, (start, _) in enumerate(places):
                    if any(low <= tuple(start) < high for low, high in silent):
                        continue
                    module = str(path.relative_to(root))
                    found.append({"module": module, "operator": name, "occurrence": occurrence, "line": start[0]})
    return found


def annotations(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return where annotations stand, and blocks that only type checkers read."""
    spans = []
    for node in ast.walk(ast.parse(source)):
        parts: list[ast.AST | None] = []
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            arguments = node.args
            everything = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
            everything += [argument for argument in (arguments.vararg, arguments.kwarg) if argument]
            parts = [node.returns, *(argument.annotation for argument in everything)]
        elif isinstance(node, ast.AnnAssign):
            parts = [node.annotation]
        elif isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            parts = [node]
        for part in parts:
            if part is not None:
                spans.append(((part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)))
    return spans


def mutated(root: Path, mutant: dict[str, Any]) -> str:
    """Return the module's source with the mutation."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    source = (root / mutant["module"]).read_text()
    code: str | None = mutate_code(source, get_operator(mutant["operator"])(), mutant["occurrence"])
    assert code is not None, mutant
    return code


def nearest_tests(root: Path, module: str, wide: bool) -> list[str]:
    """Return test files and folders, those nearest to the module first."""
    folder = Path(module).parts[1]
    near = root / "tests" / folder / f"test_{Path(module).stem}.py"
    listed = [str(near.relative_to(root))] if near.is_file() else []
    for entry in TESTS[folder] + (WIDE if wide else []):
        path = root / entry
        files = sorted(path.glob("test_*.py")) if path.is_dir() else [path] if path.is_file() else []
        listed += [str(file.relative_to(root)) for file in files if str(file.relative_to(root)) not in listed]
    return listed


def try_mutant(root: Path, tests: list[str]) -> int:
    """Run the tests in a forked child; return pytest's exit code, or -1 after the time limit."""
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        os.chdir(root)
        sys.path.insert(0, str(root))
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            import pytest

            code = 3
            with contextlib.suppress(Exception):
                code = int(pytest.main([*PYTEST, "--rootdir", str(root), *tests]))
        os._exit(code)
    deadline = time.monotonic() + TIMEOUT
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -1


def preload() -> None:
    """Load what every test run needs, but nothing of phcontrol."""
    import coal  # noqa: F401
    import pandas  # noqa: F401
    import pinocchio  # noqa: F401
    import proxsuite  # noqa: F401
    import scipy.integrate
    import scipy.linalg
    import scipy.optimize  # noqa: F401
    import tqdm  # noqa: F401
    import typer.testing  # noqa: F401
    import yourdfpy  # noqa: F401


def main() -> None:
    """Try the sampled mutants and print the share killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sample", type=int, default=0, help="how many mutants; 0 for all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folders", nargs="+", choices=FOLDERS, default=["mechanics", "controllers"])
    parser.add_argument("--only", default="", help="part of a module's path")
    parser.add_argument("--retry", type=Path, help="a file of results: try only its survivors")
    parser.add_argument("--wide", action="store_true", help="try the tests of more distant modules too")
    parser.add_argument("--out", type=Path, default=Path("mutants.jsonl"))
    options = parser.parse_args()
    everything = [mutant for mutant in mutants(ROOT, tuple(options.folders)) if options.only in mutant["module"]]
    chosen = everything
    if options.retry:
        chosen = [json.loads(line) for line in options.retry.read_text().splitlines()]
        chosen = [mutant for mutant in chosen if mutant["outcome"] == "survived"]
    elif options.sample:
        order = np.random.default_rng(options.seed).permutation(len(everything))[: options.sample]
        chosen = [everything[i] for i in order]
    print(f"{len(everything)} mutants, {len(chosen)} tried")
    preload()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "tree"
        ignore = shutil.ignore_patterns(".git", ".venv", "__pycache__", "results", ".hypothesis")
        shutil.copytree(ROOT, copy, ignore=ignore)
        counts: Counter[str] = Counter()
        for folder_name in options.folders:
            code = try_mutant(copy, nearest_tests(copy, f"phcontrol/{folder_name}/none.py", options.wide))
            assert code == 0, f"the tests of {folder_name} fail without a mutation: {code}"
        with options.out.open("w") as out:
            for mutant in chosen:
                path = copy / mutant["module"]
                original = path.read_text()
                try:
                    changed = mutated(copy, mutant)
                    path.write_text(changed)
                    result = try_mutant(copy, nearest_tests(copy, mutant["module"], options.wide))
                finally:
                    path.write_text(original)
                outcome = "survived" if result == 0 else "broken" if result in (3, 4, 5) else "killed"
                pairs = zip(original.splitlines(), changed.splitlines(), strict=False)
                lines = [after.strip() for before, after in pairs if before != after]
                record = {**mutant, "outcome": outcome, "code": result, "change": lines[:1]}
                out.write(json.dumps(record) + "\n")
                out.flush()
                counts[outcome] += 1
    print(dict(counts), f"killed {counts['killed'] / max(1, sum(counts.values())):.1%}")


if __name__ == "__main__":
    multiprocessing.set_start_method("fork", force=True)
    main()
