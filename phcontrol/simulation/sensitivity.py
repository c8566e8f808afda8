"""How what is measured of a run changes with the gains of its law."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.compilation.compiled_law import CompiledLaw
from phcontrol.controllers.controller import Controller
from phcontrol.simulation.compiled_run import plan_of, prepare
from phcontrol.simulation.log import Log
from phcontrol.simulation.log_slopes import LogSlopes
from phcontrol.simulation.run import Run

if TYPE_CHECKING:
    from phcontrol.compilation.loop_tangents import LoopTangents

_STEP = 1e-3  # of a direction, over which a law's numbers are differentiated
_MADE: weakref.WeakKeyDictionary[Any, LoopTangents] = weakref.WeakKeyDictionary()

Direction = Callable[[float], Controller]
"""The law of a run at 0, and with other gains elsewhere."""


class _Change(NamedTuple):
    """How what a run is made of changes along a direction."""

    numbers: Array
    start: Array


def gradient_along(arguments: dict[str, Any], log: Log, slopes: LogSlopes, directions: Sequence[Direction]) -> Array:
    """Return the derivative along some directions of what has given slopes of the samples of a run.

    It is that of the run as it is simulated (:class:`LoopTangents`), exact to rounding; of the law's numbers, which its
    constructor makes of its gains, and of its first state, it is by differences of fourth order.

    Args:
        arguments: of :func:`simulate`.
        log: of that run.
        slopes: of what is measured.
        directions: each a law as a function of a number.

    Raises:
        CompilationError: the run cannot be differentiated; says why.
    """
    from phcontrol.compilation.loop_tangents import LoopTangents

    beside = {"progress", "watch", "compiled", "setpoint"}
    run = Run(**{name: value for name, value in arguments.items() if name not in beside})
    others = {"a torque filter": run.filter, "a setpoint": arguments.get("setpoint"), "watch": arguments.get("watch")}
    others |= {"a joint sensor": run.joint_sensor, "a delay of the torque": run.late or None}
    found = prepare(run, others)
    tangents = _MADE.get(found.loop)
    if tangents is None:
        tangents = _MADE[found.loop] = LoopTangents(found.loop)
    given = arguments.get("controller_state0") is not None
    changes = [_change(run, direction, found.numbers.size, given) for direction in directions]
    states = np.hstack([log.position, log.velocity, log.controller_state, log.body_state])
    limit, n = run.loop.torque_limit, run.loop.n
    return tangents.sums(
        plan_of(run), found.numbers, [change.numbers for change in changes], [change.start for change in changes],
        states, slopes.weights(log), np.full(n, np.inf) if limit is None else limit, found.signals.steady,
        found.signals.table,
    )  # fmt: skip


def _change(run: Run, direction: Direction, size: int, given: bool) -> _Change:
    """Return how the numbers of a loop, which begin with its law's, and its first state change along a direction."""
    from phcontrol.compilation.law_inputs import law_numbers

    def numbers(h: float) -> Array:
        law = direction(h)
        found: Array = law_numbers(law.interpreted if isinstance(law, CompiledLaw) else law)
        return found

    n, start = run.loop.n, np.zeros(run.start.size)
    slope = np.zeros(size)
    own = central_difference(numbers, _STEP)
    slope[: own.size] = own
    if not given:
        at = run.start[:n], run.start[n : 2 * n]

        def begun(h: float) -> Array:
            law = direction(h)
            state: Array = law.initial_state(law.system.at(*at))
            return state

        states = central_difference(begun, _STEP)
        start[2 * n : 2 * n + states.size] = states
    return _Change(slope, start)
