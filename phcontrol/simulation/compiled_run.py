"""A whole run in C, where what is simulated can be compiled."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from itertools import chain
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.compiled_law import TOLERANCE, CompiledLaw, need_casadi
from phcontrol.compilation.compiler import find_compiler
from phcontrol.compilation.errors import CompilationError, CompilationWarning
from phcontrol.controllers.controller import Controller
from phcontrol.simulation.vector_field import ClosedLoop

if TYPE_CHECKING:
    from phcontrol.compilation.compiled_loop import CompiledLoop

_CHECKED = 12  # random instants at which a loop is held against the interpreted one
_DIVERGED = 1e6  # beyond it bounds fail because numbers overflow
_MADE: WeakKeyDictionary[Controller, CompiledLoop] = WeakKeyDictionary()
"""The last loop that each law was compiled in."""


def compiled_loop_of(loop: ClosedLoop, integrator: str, others: dict[str, Any]) -> CompiledLoop | None:
    """Return a closed loop in C; None, with a warning that says why, where it is simulated interpreted.

    Args:
        loop: plant, law and what is around.
        integrator: its name.
        others: what else was asked for, by name; what is not None is not compiled.
    """
    try:
        need_casadi()
    except CompilationError as error:
        _not_compiled(str(error))
        return None
    from phcontrol.compilation.compiled_loop import METHODS

    present = [name for name, value in others.items() if value is not None]
    if loop.controller.jumps:
        present.append("a law whose state jumps")
    if loop.bodies:
        present.append("bodies")
    if loop.has_varying_disturbance:
        present.append("a disturbance that is a function")
    if integrator not in METHODS:
        present.append(integrator)
    if present:
        _not_compiled(f"{', '.join(present)}: not compiled yet")
        return None
    compiler = find_compiler()
    if compiler is None:
        _not_compiled("no C compiler was found")
        return None
    law = loop.controller.interpreted if isinstance(loop.controller, CompiledLaw) else loop.controller
    known = _MADE.get(loop.controller)
    if known is not None and known.plant is loop.plant and known.is_of(law):
        return known
    try:
        made = _checked(loop, law, compiler)
    except CompilationError as error:
        _not_compiled(str(error))
        return None
    _MADE[loop.controller] = made
    return made


def _not_compiled(reason: str) -> None:
    warnings.warn(f"the run is simulated interpreted: {reason}", CompilationWarning, stacklevel=4)


def _checked(loop: ClosedLoop, law: Controller, compiler: Any) -> CompiledLoop:
    """Return the loop in C, held against the interpreted one at random instants. Raises CompilationError."""
    from phcontrol.compilation.compiled_loop import NOT_COMPILED, TRACED, CompiledLoop
    from phcontrol.compilation.instants import instants

    alike = (other.under(law) for other in list(_MADE.values()) if other.plant is loop.plant)
    made = next((found for found in alike if found is not None), None) or CompiledLoop(loop.plant, law, compiler)
    plain = ClosedLoop(loop.plant, law, np.zeros(loop.n))
    worst, looked = 0.0, 0
    for instant, _ in chain(instants(law, TRACED, seed=1), instants(law, _CHECKED, seed=3)):
        y = np.concatenate([instant.position, instant.velocity, instant.state])
        status, rate, torque = made.field(instant.time, y, np.zeros(loop.n), None)
        if status == NOT_COMPILED:
            continue
        expected = plain.evaluate(instant.time, y)
        looked += 1
        for one, other in ((rate, expected.rate), (torque, expected.torque)):
            worst = max(worst, float(np.abs(one - other).max() / max(1e-3, float(np.abs(other).max()))))
    if not looked or not worst <= TOLERANCE:
        raise CompilationError(f"the loop as compiled is refused: it differs from the interpreted one by {worst:.1e}")
    return made


def run_compiled(
    made: CompiledLoop,
    loop: ClosedLoop,
    states: Array,
    torques: Array,
    dt: float,
    integrator: str,
    control_period: float | None,
    stride: int,
    after: Callable[[int], None],
) -> bool:
    """Fill states and torques of a run; False where it must be simulated interpreted after all, which is said.

    A run that diverges, or whose torque is not finite, is one of these: the interpreted run then says what is wrong.
    """
    from phcontrol.compilation.compiled_loop import DONE, NOT_COMPILED

    status, reached = made.run(
        len(states) - 1, dt, integrator, loop.steady_force, loop.torque_limit, states, torques, stride=stride,
        period=control_period or 0.0, after=after,
    )  # fmt: skip
    if status == NOT_COMPILED and np.abs(states[reached]).max() < _DIVERGED:
        _not_compiled(f"at t = {reached * dt:g} s it takes a branch that is not compiled")
    if status == DONE and _tank_was_not_told(loop, torques):
        _not_compiled("a torque is clipped, for which the law's tank must pay")
        return False
    return status == DONE


def _tank_was_not_told(loop: ClosedLoop, torques: Array) -> bool:
    """Return whether a law with a tank had a torque clipped: compiled loops leave its rate as it is."""
    law, limit = loop.controller, loop.torque_limit
    if limit is None or law.tank_level(np.zeros(law.state_size)) is None:
        return False
    return bool((np.abs(torques) >= limit).any())
