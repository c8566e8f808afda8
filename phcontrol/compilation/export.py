"""A law as C files to take away."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import casadi
import numpy as np

from phcontrol._files import write_text
from phcontrol._validation import Array
from phcontrol._version import __version__
from phcontrol.compilation import export_texts
from phcontrol.compilation.c_code import Function, function, literal, variant
from phcontrol.compilation.eigenvalues import written_out
from phcontrol.compilation.errors import CompilationError
from phcontrol.compilation.instants import instants
from phcontrol.compilation.symbol import Guards, Symbol, symbols
from phcontrol.compilation.trace import Instant, TracedLaw, trace_law, values_of
from phcontrol.compilation.traced_state import TracedState, traced_system
from phcontrol.compilation.tracing import classes_of, refusal, tracing
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.controllers.tuning import Tuning

CASES = 24
"""Recorded states in what is exported."""
TOLERANCE = {"double": 1e-9, "float": 5e-3}
"""By how much, relatively, the exported law may differ from the interpreted one, in doubles and in floats."""
_TRACED = 64


class Exported(NamedTuple):
    """What was written."""

    files: tuple[Path, ...]
    operations: int
    """Of arithmetic, at most, in one step."""
    ways: int
    """How many ways through the law's branches are in it."""
    difference: float
    """Largest relative difference of the expressions from the interpreted law at the recorded states."""


def export_law(controller: Controller, folder: str | Path, *, single: bool = False) -> Exported:
    """Write a law as C99 into a folder: law.c, law.h, main.c that replays recorded cases, CMakeLists.txt, README.md.

    What is written needs no phcontrol, no allocation and no library but the mathematical one. It is traced from the
    law's own file, and its expressions are held against the interpreted law before they are written.

    Args:
        controller: the law.
        folder: where to; files of these names there are replaced.
        single: write floats in place of doubles.

    Raises:
        CompilationError: the law cannot be traced (names the line), or what was traced is not what it orders.
        DataFileError: the folder cannot be written to.
    """
    check_loop(controller, getattr(controller, "system", None))
    law: Controller = getattr(controller, "interpreted", controller)
    if law.jumps:
        raise CompilationError(f"{law.name} cannot be exported: its state jumps, which no step in C does")
    beginning = _beginning(law)
    own = list(instants(law, _TRACED, seed=1))
    traced = trace_law(law, [instant for instant, _ in own])
    _recorded(law, traced, own)  # each way is held against the law where it was traced
    cases = _recorded(law, traced, instants(law, 4 * CASES, seed=2))[:CASES]
    functions = [variant(f"way_{k}", traced, trace, single) for k, trace in enumerate(traced.traces)]
    operations = max(found.operations for found in functions)
    texts = _texts(law, traced, functions, cases, operations, single, beginning)
    files = tuple(write_text(Path(folder) / name, text) for name, text in texts.items())
    return Exported(files, operations, len(functions), max(case.difference for case in cases))


def _beginning(law: Controller) -> Array:
    """Return the state that a law begins with. Raises CompilationError when that depends on the arm's."""
    system, generator = law.system, np.random.default_rng(0)
    first = law.initial_state(system.at(system.robot.home))
    for _ in range(3):
        x = system.at(system.robot.random_position(generator), generator.normal(size=system.n))
        if not np.array_equal(law.initial_state(x), first):
            raise CompilationError(
                f"{law.name} cannot be exported: its initial state depends on the arm's, which law_init does not know"
            )
    return first


class _Case(NamedTuple):
    instant: Instant
    command: Command
    gravity: Array
    measured: Array
    difference: float


def _recorded(law: Controller, traced: TracedLaw, asked: Iterable[tuple[Instant, Command]]) -> list[_Case]:
    """Return those of some states at which the traced law answers, and what the interpreted one orders there."""
    evaluated = [
        casadi.Function(
            "law",
            traced.inputs,
            [
                written_out(casadi.vertcat(casadi.SX(1), *trace.guards)),
                written_out(casadi.vertcat(*trace.torque, *trace.rate)),
            ],
        )
        for trace in traced.traces
    ]
    found: list[_Case] = []
    for instant, command in asked:
        values = values_of(traced.layout, instant, traced.numbers)
        for evaluate in evaluated:
            guards, answer = (np.array(part).ravel() for part in evaluate(*values))
            if not guards.all():
                continue
            expected = np.concatenate(command)
            x = law.system.at(instant.position)
            gravity = law.system.motor_torque(x.potential_gradient)
            difference = float(np.abs(answer - expected).max() / max(float(np.abs(expected).max()), 1e-9))
            found.append(_Case(instant, command, np.array(gravity), values[4], difference))
            break
    if not found:
        raise CompilationError(f"{law.name} as traced answers at no random state")
    worst = max(case.difference for case in found)
    if not worst <= TOLERANCE["double"]:
        raise CompilationError(
            f"{law.name} as traced is refused: it differs from the interpreted law by {worst:.1e}, relatively"
        )
    return found


def _still(law: Controller, traced: TracedLaw, damped: bool) -> list[Any]:
    """Return what compensates gravity, and damps motion too: u = G⁻¹∂V/∂q − C Gᵀq̇, as expressions."""
    system, guards = law.system, Guards()
    damping = law.injected_damping
    if damping is None:
        damping = Tuning(system, system.robot.home, system.robot.home).damping
    entries = [
        symbols([Symbol(entry, 0.1, guards) for entry in casadi.vertsplit(traced.inputs[which])]) for which in (1, 2)
    ]
    try:
        with tracing(classes_of(law)):
            x = TracedState(traced_system(system), *entries)
            torque = system.motor_torque(x.potential_gradient)
            if damped:
                torque = torque - damping.dot(x.output)
    except Exception as error:
        raise refusal(f"gravity of {system.robot.name}", error) from error
    if guards.expressions:
        raise CompilationError(f"the potential of {system.robot.name} has branches, and no torque to stop with")
    return [entry.expression if type(entry) is Symbol else casadi.SX(float(entry)) for entry in torque]


def _harmless(text: str) -> str:
    """Return a name from a file without what would end a comment in C, or a line."""
    return re.sub(r"[^\w .,:()+-]", "?", text)


def _texts(
    law: Controller,
    traced: TracedLaw,
    functions: list[Function],
    cases: list[_Case],
    operations: int,
    single: bool,
    beginning: Array,
) -> dict[str, str]:
    """Return the files by name."""
    layout, real = traced.layout, "float" if single else "double"
    joints, states, measured = layout.joints, layout.state, layout.measured_size

    def numbers(values: Iterable[float]) -> str:
        return ", ".join(literal(float(value), single) for value in values) or literal(0.0, single)

    def row(case: _Case) -> str:
        instant, command = case.instant, case.command
        vectors = (
            instant.position, instant.velocity, instant.state, case.measured, command.torque, command.state_rate,
            case.gravity,
        )  # fmt: skip
        return f"  {{{numbers([instant.time])}, " + ", ".join(f"{{{numbers(vector)}}}" for vector in vectors) + "},"

    gravity = function("gravity", traced.inputs, [], _still(law, traced, damped=False), single)
    stop = function("stop", traced.inputs, [], _still(law, traced, damped=True), single)
    names = ", ".join(f"{name} ({size})" for name, size in layout.measured) or "nothing"
    forces = [name for name, _ in layout.measured] == ["external_force"]
    robot = _harmless(law.system.robot.name)
    title = f"{_harmless(type(law).__name__)} ({law.interconnection}) of {robot}, {joints} joints."
    common = {
        "title": title, "version": __version__, "real": real, "joints": joints, "states": states,
        "measured": measured, "measured_names": names, "operations": operations,
        "state_room": max(1, states), "measured_room": max(1, measured), "ways": len(functions),
    }  # fmt: skip
    calls = " || ".join(f"way_{k}(t, q, v, state, measured, p, out)" for k in range(len(functions)))
    source = export_texts.SOURCE.format(
        **common,
        numbers=numbers(traced.numbers),
        numbers_room=max(1, traced.numbers.size),
        beginning=numbers(beginning),
        functions="\n".join(found.text for found in (*functions, gravity, stop)),
        outputs=joints + states,
        calls=calls,
    )
    main = export_texts.MAIN.format(
        **common, cases=len(cases), tolerance=TOLERANCE[real], rows="\n".join(row(case) for case in cases)
    )
    readme = export_texts.README.format(
        **common,
        law=_harmless(law.name),
        robot=robot,
        cases=len(cases),
        joint_names=_harmless(", ".join(law.system.robot.joint_names)),
        libfranka_measured="state.tau_ext_hat_filtered.data()" if forces else "measured" if measured else "nullptr",
        ros_measured="measured" if measured else "nullptr",
    )
    return {
        "law.h": export_texts.HEADER.format(**common),
        "law.c": source,
        "main.c": main,
        "CMakeLists.txt": export_texts.CMAKE,
        "README.md": readme,
    }
