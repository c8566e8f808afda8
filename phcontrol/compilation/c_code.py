"""Expressions as C."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi

from phcontrol.compilation.eigenvalues import Eigenvalues, blocks_of, c_text, written_out
from phcontrol.compilation.errors import NotTraceableError
from phcontrol.compilation.trace import Trace, TracedLaw

_INFIX = {"OP_ADD": "+", "OP_SUB": "-", "OP_MUL": "*", "OP_DIV": "/"}
_COMPARE = {"OP_LT": "<", "OP_LE": "<=", "OP_EQ": "==", "OP_NE": "!=", "OP_AND": "&&", "OP_OR": "||"}
_CALLS = {
    "OP_EXP": "exp", "OP_LOG": "log", "OP_SQRT": "sqrt", "OP_SIN": "sin", "OP_COS": "cos", "OP_TAN": "tan",
    "OP_ASIN": "asin", "OP_ACOS": "acos", "OP_ATAN": "atan", "OP_TANH": "tanh", "OP_FLOOR": "floor",
    "OP_CEIL": "ceil", "OP_FABS": "fabs", "OP_FMOD": "fmod", "OP_ATAN2": "atan2", "OP_FMIN": "fmin",
    "OP_FMAX": "fmax", "OP_POW": "pow", "OP_CONSTPOW": "pow", "OP_HYPOT": "hypot", "OP_COPYSIGN": "copysign",
    "OP_LOG1P": "log1p", "OP_EXPM1": "expm1",
}  # fmt: skip
_UNARY = {
    "OP_NEG": "-{0}", "OP_SQ": "{0} * {0}", "OP_TWICE": "{0} + {0}", "OP_INV": "{1} / {0}",
    "OP_SIGN": "(real)(({0} > 0) - ({0} < 0))", "OP_NOT": "(real)!{0}",
}  # fmt: skip
_LANE_UNARY = {
    "OP_NEG": "-{0}", "OP_SQ": "{0} * {0}", "OP_TWICE": "{0} + {0}", "OP_INV": "1.0 / {0}",
    "OP_SIGN": "TRUTH({0} > 0.0) - TRUTH({0} < 0.0)", "OP_NOT": "TRUTH({0} == 0.0)",
}  # fmt: skip
_NAMES = (*_INFIX, *_COMPARE, *_CALLS, *_UNARY, "OP_IF_ELSE_ZERO")
_OPERATIONS = {getattr(casadi, name): name for name in _NAMES if hasattr(casadi, name)}
_WORD = re.compile(r"\b[ae]\d+\b")  # a value or a decomposition
_LARGEST_FLOAT = 3.4028234e38
_LEAST_SINGLE = 1e-18  # squares of smaller floats lose digits

INPUTS = ("t", "q", "v", "s", "m", "p")
"""What a function reads: time, q, q̇, the law's state, what is measured, its numbers."""


class Function(NamedTuple):
    """A function in C and what it costs."""

    text: str
    operations: int
    """How many arithmetic operations it does at most."""


class Branch(NamedTuple):
    """One way through a computation."""

    guards: list[Any]
    """Expressions that are all 1 where it is the way."""
    outputs: list[Any]
    """Expressions."""


def literal(value: float, single: bool) -> str:
    """Return a number as C writes it."""
    if single and 0.0 < abs(value) < _LEAST_SINGLE:  # a bound on what may be divided by; floats do not hold it
        value = math.copysign(_LEAST_SINGLE, value)
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    if single and abs(value) > _LARGEST_FLOAT:
        value = math.copysign(_LARGEST_FLOAT, value)
    text = repr(value)
    if not any(mark in text for mark in ".en"):
        text += ".0"
    text += "f" if single else ""
    return f"({text})" if value < 0 else text


def function(
    name: str, inputs: list[Any], guards: list[Any], outputs: list[Any], single: bool = False, lanes: bool = False
) -> Function:
    """Return ``static int name(...)``: it fills ``out`` and returns 1, or 0 where a guard does not hold.

    Guards come first, so that a way that is not the law's is left early. Every intermediate is a constant of its own:
    no memory, no loop, no branch but the guards. Decompositions into eigenvalues are called. With ``lanes`` numbers are
    vectors of several runs, see ``lanes.PRELUDE``, a mask is returned of those whose guards hold, and decompositions
    are written out.
    """
    wanted = casadi.vertcat(casadi.SX(0, 1), *guards, *outputs)
    wanted = written_out(wanted) if lanes else wanted
    blocks = blocks_of(wanted)
    wanted = casadi.vertcat(wanted, *(block.given for block in blocks))
    made = casadi.Function("f", [*inputs, *(block.results for block in blocks)], [casadi.cse(wanted)])
    calls = _Calls(name, blocks, len(guards) + len(outputs), single)
    suffix, one = ("f" if single else ""), literal(1.0, single)
    lines: list[str] = []
    looked: set[str] = set()  # conditions, each once
    names: dict[int, str] = {}
    count = operations = 0
    for k in range(made.n_instructions()):
        code = made.instruction_id(k)
        if code == casadi.OP_OUTPUT:
            place, value = made.instruction_output(k)[1], names[made.instruction_input(k)[0]]
            if calls.takes(place, value):
                continue
            if place < len(guards):
                line = f"ok &= {value} != 0.0;" if lanes else f"if (!({value} != 0)) return 0;"
                if line not in looked:
                    lines.append(line)
                looked.add(line)
            else:
                if lanes and guards and place == len(guards):
                    lines.append("if (!any(ok)) return ok;")
                lines.append(f"out[{place - len(guards)}] = {_of_lanes(value) if lanes else value};")
            continue
        target = made.instruction_output(k)[0]
        if code == casadi.OP_CONST:
            names[target] = literal(made.instruction_constant(k), single)
            continue
        if code == casadi.OP_INPUT:
            which, place = made.instruction_input(k)
            names[target] = "t" if which == 0 else f"{[*INPUTS, *calls.names][which]}[{place}]"
            continue
        operands = [names[index] for index in made.instruction_input(k)]
        if lanes:
            lines.append(f"const real a{count} = {_lane_expression(code, operands)};")
            names[target] = f"a{count}"
            count, operations = count + 1, operations + 1
            continue
        lines.append(f"const real a{count} = {_expression(code, operands, suffix, one)};")
        names[target] = f"a{count}"
        count, operations = count + 1, operations + 1
    # what no output was written for is zero throughout
    written = {line.partition("[")[2].partition("]")[0] for line in lines if line.startswith("out[")}
    zero = _of_lanes(literal(0.0, single)) if lanes else literal(0.0, single)
    lines += [f"out[{k}] = {zero};" for k in range(len(outputs)) if str(k) not in written]
    body = "\n  ".join(calls.ordered(lines) if blocks else lines)
    arguments = ", ".join(("real t", *(f"const real *{name}" for name in INPUTS[1:]), "real *out"))
    unused = " ".join(f"(void){name};" for name in INPUTS)
    kind, first, last = ("mask", "mask ok = EVERY; ", "ok") if lanes else ("int", "", "1")
    head = f"{calls.functions}static {kind} {name}({arguments})"
    return Function(
        f"{head} {{\n  {first}{unused} (void)out;\n  {body}\n  return {last};\n}}\n",
        operations + calls.operations,
    )


class _Calls:
    """The decompositions that a function calls: which values they take, and where the calls go among its lines."""

    def __init__(self, name: str, blocks: Sequence[Eigenvalues], start: int, single: bool) -> None:
        self._blocks, self._start = blocks, start
        self.names = [f"e{k}" for k in range(len(blocks))]
        self._given = [["0"] * block.given.numel() for block in blocks]
        self._makers = {size: f"{name}_eigenvalues_{size}" for size in sorted({block.size for block in blocks})}
        self.functions, self.operations = "", 0
        for size, maker in self._makers.items():
            text, operations = c_text(maker, size, lambda value: literal(value, single), "f" if single else "")
            self.functions += text + "\n"
            self.operations += operations * sum(block.size == size for block in blocks)

    def takes(self, place: int, value: str) -> bool:
        """Note a value if an output is one that a decomposition takes."""
        place -= self._start
        if place < 0:
            return False
        for given in self._given:
            if place < len(given):
                given[place] = value
                return True
            place -= len(given)
        return True

    def ordered(self, lines: list[str]) -> list[str]:
        """Return lines with the calls among them, each after what it needs, and as late as it can be."""
        made = {
            line.partition(" = ")[0].removeprefix("const real "): line for line in lines if line.startswith("const")
        }
        for name, block, given in zip(self.names, self._blocks, self._given, strict=True):
            call = f"{self._makers[block.size]}({name}_given, {name});"
            made[name] = (
                f"real {name}[{block.results.numel()}]; const real {name}_given[] = {{{', '.join(given)}}}; {call}"
            )
        needs = {
            name: [word for word in _WORD.findall(line) if word in made and word != name] for name, line in made.items()
        }
        result: list[str] = []
        done: set[str] = set()
        for line in (line for line in lines if not line.startswith("const")):
            waiting = [word for word in _WORD.findall(line) if word in made]
            while waiting:
                if waiting[-1] in done:
                    waiting.pop()
                    continue
                missing = [name for name in needs[waiting[-1]] if name not in done]
                if missing:
                    waiting.extend(missing)
                    continue
                done.add(waiting[-1])
                result.append(made[waiting.pop()])
            result.append(line)
        return result


def _expression(code: int, operands: list[str], suffix: str, one: str) -> str:
    name = _OPERATIONS.get(code)
    if name in _INFIX:
        return f" {_INFIX[name]} ".join(operands)
    if name in _COMPARE:
        return f"(real)({operands[0]} {_COMPARE[name]} {operands[1]})"
    if name in _CALLS:
        return f"{_CALLS[name]}{suffix}({', '.join(operands)})"
    if name in _UNARY:
        return _UNARY[name].format(operands[0], one)
    if name == "OP_IF_ELSE_ZERO":
        return f"{operands[0]} != 0 ? {operands[1]} : 0"
    raise NotTraceableError(f"operation {code} of CasADi is not written as C")


def _of_lanes(value: str) -> str:
    """Return a value as a vector: a number is the same in all lanes."""
    return value if value[0].isalpha() and value not in ("NAN", "INFINITY") else f"SAME({value})"


def _lane_expression(code: int, operands: list[str]) -> str:
    """Return an operation on vectors; of infix operators one side may be a plain number."""
    name = _OPERATIONS.get(code)
    vectors = [_of_lanes(value) for value in operands]
    plain = all(one != other for one, other in zip(vectors, operands, strict=True))
    mixed = vectors if plain else operands
    if name in _INFIX:
        return f" {_INFIX[name]} ".join(mixed)
    if name in ("OP_AND", "OP_OR"):
        return f"TRUTH(({vectors[0]} != 0.0) {'&' if name == 'OP_AND' else '|'} ({vectors[1]} != 0.0))"
    if name in _COMPARE:
        return f"TRUTH({mixed[0]} {_COMPARE[name]} {mixed[1]})"
    if name in _CALLS:
        return f"v_{_CALLS[name]}({', '.join(vectors)})"
    if name in _LANE_UNARY:
        return _LANE_UNARY[name].format(vectors[0])
    if name == "OP_IF_ELSE_ZERO":
        return f"choose({vectors[0]} != 0.0, {vectors[1]}, SAME(0.0))"
    raise NotTraceableError(f"operation {code} of CasADi is not written as C")


def ways(name: str, inputs: list[Any], traces: list[Branch], lanes: bool) -> Function:
    """Return ``static mask name(wanted, ...)``: the first way whose guards hold fills ``out``, lane by lane.

    Returned is where one was found; it is enough to find one in the lanes that are wanted.
    """
    functions = [
        function(f"{name}_{k}", inputs, trace.guards, trace.outputs, lanes=lanes) for k, trace in enumerate(traces)
    ]
    size, names = len(traces[0].outputs), ", ".join(INPUTS)
    arguments = ", ".join(("mask wanted", "real t", *(f"const real *{one}" for one in INPUTS[1:]), "real *out"))
    lines = [f"mask ok = WAY({name}_0({names}, out));"]
    if len(functions) > 1:
        lines += ["if (!any(wanted & ~ok)) return ok;", f"real other[{size or 1}];", "mask also;"]
    for k in range(1, len(functions)):
        lines += [
            f"also = WAY({name}_{k}({names}, other)) & ~ok;",
            f"for (int i = 0; i < {size}; i++) out[i] = choose(also, other[i], out[i]);",
            "ok |= also;",
            "if (!any(wanted & ~ok)) return ok;",
        ]
    body = "\n  ".join(lines)
    text = f"static mask {name}({arguments}) {{\n  (void)wanted;\n  {body}\n  return ok;\n}}\n"
    return Function("\n".join([*(one.text for one in functions), text]), max(one.operations for one in functions))


def variant(name: str, law: TracedLaw, trace: Trace, single: bool = False) -> Function:
    """Return one way through a law as a function whose ``out`` is torque and state rate."""
    return function(name, law.inputs, trace.guards, [*trace.torque, *trace.rate], single)


def law_source(law: TracedLaw) -> Function:
    """Return a C file with ``int phcontrol_law(t, q, v, s, m, p, out)``: 1, or 0 where none of the traces is right."""
    functions = [variant(f"way_{k}", law, trace) for k, trace in enumerate(law.traces)]
    calls = " || ".join(f"way_{k}(t, q, v, s, m, p, out)" for k in range(len(functions)))
    arguments = ", ".join(("real t", *(f"const real *{name}" for name in INPUTS[1:]), "real *out"))
    texts = "\n".join(found.text for found in functions)
    text = (
        "/* Made by phcontrol of a law's own file. */\n#include <math.h>\ntypedef double real;\n\n"
        f"{texts}\nint phcontrol_law({arguments});\nint phcontrol_law({arguments}) {{ return {calls}; }}\n"
    )
    return Function(text, max(found.operations for found in functions))
