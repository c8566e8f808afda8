"""The mutants of a source file, made by Cosmic Ray, and what a mutant changes."""

from __future__ import annotations

import ast
import difflib
from collections.abc import Iterator
from pathlib import Path
from types import CodeType
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

SLIPS = {
    "Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul",
    "Lt_LtE", "Lt_Gt", "LtE_Lt", "LtE_GtE", "Gt_GtE", "Gt_Lt", "GtE_Gt", "GtE_LtE", "Eq_NotEq", "NotEq_Eq", "Is_IsNot",
    "IsNot_Is", "Delete_USub", "Delete_Not",
}  # fmt: skip


def mutants(root: Path, module: str) -> list[dict[str, Any]]:
    """List the mutants of a module (a path relative to ``root``): operator, occurrence and place."""
    source = (root / module).read_text()
    tree, silent = get_ast(source), _annotations(source)
    found = []
    for name in sorted(operator_names()):
        if "Operator_" in name and name.split("Operator_")[1] not in SLIPS:
            continue
        operator_class = get_operator(name)
        if operator_class.arguments():
            continue  # needs to be told what to replace by what
        operator = operator_class()
        places = [place for node in ast_nodes(tree) for place in operator.mutation_positions(node)]
        for occurrence, (start, _) in enumerate(places):
            if not any(low <= tuple(start) < high for low, high in silent) and not _unpacks(source, *start):
                found.append({"module": module, "operator": name, "occurrence": occurrence, "line": start[0]})
    return found


def mutated(source: str, operator: str, occurrence: int) -> str | None:
    """Return the source with the mutation; None if there is no such occurrence."""
    code: str | None = mutate_code(source, get_operator(operator)(), occurrence)
    return code


def change(before: str, after: str) -> list[str]:
    """Return the lines that a mutant takes out and puts in, stripped and each joined to one line.

    One that many places have (a decorator, a ``break``) comes with its neighbour.
    """
    old = before.splitlines()
    lines = list(difflib.ndiff(old, after.splitlines()))
    out, put = (
        " ".join(line[2:].strip() for line in lines if line.startswith(sign) and line[2:].strip())
        for sign in ("- ", "+ ")
    )
    first = next(k for k, line in enumerate(lines) if line.startswith(("- ", "+ ")) and line[2:].strip())
    if out.startswith("@"):
        return [f"{out} {old[first + 1].strip()}", f"{put} {old[first + 1].strip()}".strip()]
    if out in ("break", "continue", "pass"):
        return [f"{old[first - 1].strip()} {out}", f"{old[first - 1].strip()} {put}"]
    return [out, put]


def changed_function(before: str, after: str) -> tuple[CodeType, CodeType] | None:
    """Return the outermost function that a mutant changes, before and after; None if it is no function's body.

    Raises:
        EqualCodeError: the mutant compiles to the same instructions.
    """
    pairs = list(_differences(compile(before, "x", "exec"), compile(after, "x", "exec")))
    if not pairs:
        raise EqualCodeError
    return None if pairs[0] is None or len(pairs) > 1 else pairs[0]


class EqualCodeError(Exception):
    """A mutant is the same program, instruction by instruction."""


def statement(source: str, line: int) -> range:
    """Return the lines of the innermost statement around a line; of a compound statement, those of its header."""
    found = range(line, line + 1)
    for node in ast.walk(ast.parse(source)):  # outer before inner
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or node.lineno):
            body = getattr(node, "body", None)
            if not body:
                found = range(node.lineno, (node.end_lineno or node.lineno) + 1)
            elif line < body[0].lineno:
                found = range(node.lineno, body[0].lineno)
    return found


def enclosing(source: str, line: int) -> range:
    """Return the lines of the definition that a line out of every function's body belongs to; else the module's."""
    found = range(1, len(source.splitlines()) + 1)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            if first <= line <= (node.end_lineno or first):
                found = range(first, (node.end_lineno or first) + 1)
    return found


def function_lines(source: str) -> set[int]:
    """Return the lines inside function bodies: those that importing the module does not execute by itself."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            lines.update(range(node.body[0].lineno, (node.end_lineno or node.lineno) + 1))
    return lines


def _unpacks(source: str, line: int, column: int) -> bool:
    """Report whether a star unpacks arguments or stands in a signature: Cosmic Ray takes it for a product."""
    lines = source.splitlines()
    before = " ".join([*lines[max(0, line - 3) : line - 1], lines[line - 1][:column]]).rstrip()
    return lines[line - 1][column : column + 1] == "*" and before[-1:] in tuple("([{,=:")


def _annotations(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return where annotations stand, and blocks that only type checkers read."""
    spans = []
    for node in ast.walk(ast.parse(source)):
        parts: list[ast.AST | None] = []
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            arguments = node.args
            everything = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
            everything += [argument for argument in (arguments.vararg, arguments.kwarg) if argument]
            overload = [d for d in node.decorator_list if isinstance(d, ast.Name) and d.id == "overload"]
            parts = [node] if overload else [node.returns, *(argument.annotation for argument in everything)]
            parts += overload
        elif isinstance(node, ast.AnnAssign):
            parts = [node.annotation]
        elif isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            parts = [node]
        for part in parts:
            if part is not None:
                spans.append(((part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)))
    return spans


def _differences(before: CodeType, after: CodeType) -> Iterator[tuple[CodeType, CodeType] | None]:
    """Yield the outermost functions that differ, and None for a module's or class's own code that does."""
    if _own(before) == _own(after) and not before.co_flags & 1:  # CO_OPTIMIZED: a function
        for old, new in zip(_nested(before), _nested(after), strict=True):
            yield from _differences(old, new)
    elif _fingerprint(before) != _fingerprint(after):
        yield (before, after) if before.co_flags & 1 and before.co_freevars == after.co_freevars else None


def _nested(code: CodeType) -> list[CodeType]:
    return [constant for constant in code.co_consts if isinstance(constant, CodeType)]


def _own(code: CodeType) -> tuple[Any, ...]:
    """What a code object does itself: everything but where it stands and what is nested in it."""
    constants = [type(c).__name__ if isinstance(c, CodeType) else repr(c) for c in code.co_consts]
    return code.co_code, constants, code.co_names, code.co_varnames, code.co_flags, code.co_exceptiontable


def _fingerprint(code: CodeType) -> tuple[Any, ...]:
    return _own(code), [_fingerprint(nested) for nested in _nested(code)]
