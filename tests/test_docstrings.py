"""Every public name has an example in its docstring, which runs as printed and shows a value."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import itertools
import re
from pathlib import Path

import pytest

import phcontrol
from phcontrol.compilation.compiler import find_compiler

STUB = Path(phcontrol.__file__).with_name("__init__.pyi").read_text(encoding="utf-8")
MODULES = {
    name: f"phcontrol.{module}"
    for module, several, one in re.findall(r"^from \.([\w.]+) import (?:\(([^)]*)\)|(.*))$", STUB, re.MULTILINE)
    for name in re.findall(r"\w+", several or one)
}
COMPILED = {"LoopDerivatives", "compile_law"}
"""Names whose examples need a C compiler."""


def docstring(name: str) -> str:
    """Return the docstring of a public name; that of a constant is the text after it."""
    found = getattr(phcontrol, name)
    if inspect.isclass(found) or inspect.isroutine(found):
        return inspect.getdoc(found) or ""
    module = importlib.import_module(MODULES.get(name, "phcontrol._version"))
    body = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body
    for statement, following in itertools.pairwise(body):
        targets = getattr(statement, "targets", [getattr(statement, "target", None)])
        if any(getattr(target, "id", None) == name for target in targets) and isinstance(following, ast.Expr):
            return inspect.cleandoc(ast.literal_eval(following.value))
    return ""


def problems(name: str, text: str) -> list[str]:
    """Return what is wrong with the examples of a docstring."""
    examples = doctest.DocTestParser().get_examples(text)
    if not any(example.want for example in examples):
        return [f"{name} has no example that shows a value"]
    if any(doctest.SKIP in example.options for example in examples):
        return [f"an example of {name} is skipped"]
    said: list[str] = []
    test = doctest.DocTest(examples, {}, name, None, None, text)
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    return said


@pytest.mark.parametrize("name", phcontrol.__all__)
def test_the_example_of_a_public_name_runs_as_printed(name, tmp_path, monkeypatch):
    if name in COMPILED and find_compiler() is None:
        pytest.skip("no C compiler: laws cannot be compiled here")
    monkeypatch.setenv("PHCONTROL_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    assert problems(name, docstring(name)) == []
    assert [path.name for path in tmp_path.iterdir() if path.name != "cache"] == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("A thing.", "no example"),
        (">>> x = 1", "no example"),
        (">>> 1 + 1\n3", "Expected:\n    3\nGot:\n    2"),
        (">>> 1 + 1  # doctest: +SKIP\n2", "is skipped"),
        (">>> undefined\n2", "NameError"),
    ],
)
def test_a_docstring_without_a_true_example_is_found(text, problem):
    assert problem in "\n".join(problems("thing", text))
