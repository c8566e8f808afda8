"""Whether a law's methods answer with what they are asked for, before it is looked at what they say."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from phcontrol._validation import Array, described, number
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.answers import check_vector
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.exceptions import AnswerError
from phcontrol.mechanics.system import MechanicalSystem

_AWAY, _SPEED = 0.01, 0.1  # from where it rests, in radians and radians a second


def check_well_formed(law: Controller, plant: MechanicalSystem) -> None:
    """Raise AnswerError, naming class and method, where a law answers with something of another kind or shape.

    Asked are all methods that laws have, at a state near where it rests that moves, and at rest.
    """
    _check_words(law)
    n, m = plant.n, law.state_size
    for method in ("target_posture", "rest_posture"):
        posture: Any = getattr(law, method)(0.0)
        if posture is not None or method == "rest_posture":
            check_vector(law, method, posture, n)
    posture = np.array(law.rest_posture(0.0))
    resting = law.system.at(posture)
    check_vector(law, "initial_state", law.initial_state(resting), m)
    force = law.rest_force(resting)
    if force is not None:
        check_vector(law, "rest_force", force, n)
    still = np.zeros(n)
    at = SampledState(0.0, posture, still, law.initial_state(resting), still, law.rest_scene(resting), "")
    for away, speed in ((0.0, 0.0), (_AWAY, _SPEED)):
        moved = at._replace(position=posture + away, velocity=np.full(n, speed))
        _check_answers(law, Seen.of(law, plant, moved), n, m)


def _check_words(law: Controller) -> None:
    for method in ("caveat", "driven_by", "lacks_minimum", "other_rests"):
        words: Any = getattr(law, method)
        if not isinstance(words, str):
            raise AnswerError(type(law), method, f"is {described(words)}, expected a str, empty for none")
    states: Any = law.states
    if not isinstance(states, tuple) or not all(isinstance(name, str) for name in states):
        raise AnswerError(type(law), "states", f'is {described(states)}, expected a tuple of names, like ("pull",)')
    span: Any = law.time_span
    if isinstance(span, bool) or not isinstance(span, (int, float, np.floating)):
        raise AnswerError(type(law), "time_span", f"is {described(span)}, expected a number [s]")
    number(f"{type(law).__name__}.time_span", float(span), minimum=0.0)
    phases: Any = law.phases
    if not isinstance(phases, tuple) or not phases or not all(map(_is_time, phases)) or phases[0] != 0.0:
        raise AnswerError(type(law), "phases", f"is {described(phases)}, expected a tuple of times [s], the first 0")
    if any(later <= before for before, later in pairwise(phases)):
        raise AnswerError(type(law), "phases", f"is {phases}, expected times that increase [s]")
    period: Any = law.longest_period
    if isinstance(period, bool) or not isinstance(period, (int, float, np.floating)) or not period > 0.0:
        what = period if isinstance(period, (int, float)) else described(period)
        raise AnswerError(type(law), "longest_period", f"is {what}, expected a number > 0 [s], infinite for any period")


def _is_time(value: Any) -> bool:
    return isinstance(value, (int, float, np.floating)) and not isinstance(value, bool) and math.isfinite(value)


def _check_port(law: Controller, asked: tuple[Any, ...], n: int) -> None:
    try:
        port: Any = law.passive_port(*asked)
    except Exception:
        return  # it is asked again, after what says more plainly what is wrong: a state that is not promised
    if not isinstance(port, PassivePort):
        raise AnswerError(type(law), "passive_port", f"returned {described(port)}, expected a PassivePort")
    for name, value in (("output", port.output), ("resistance", port.resistance)):
        check_vector(law, "passive_port", value, n, f" as {name}")


def _check_answers(law: Controller, seen: Seen, n: int, m: int) -> None:
    at = seen.at
    asked = at.time, seen.view, at.state, seen.measured
    if type(law).evaluate is Controller.evaluate:
        shape: Any = law.shape(*asked)
        if not isinstance(shape, Shaping):
            raise AnswerError(type(law), "shape", f"returned {described(shape)}, expected a Shaping")
        check_vector(law, "shape", shape.effort, n, " as effort")
    seen.stored()
    promise = seen.promise()
    check_vector(law, "coordinates", law.coordinates(*asked), len(promise.coordinates))
    rate = seen.command().state_rate
    _check_port(law, asked, n)
    vectors: dict[str, Array] = {
        "calmest_state": law.calmest_state(at.time, seen.view, at.state),
        "jump": law.jump(*asked),
        "rate_under_limits": law.rate_under_limits(at.time, seen.view, at.state, rate, np.zeros(n), seen.measured),
    }
    for method, value in vectors.items():
        check_vector(law, method, value, m)
    check_vector(law, "reference_velocity", law.reference_velocity(at.time, seen.view), n)
    desired = law.desired_posture(at.time, at.state)
    if desired is not None:
        check_vector(law, "desired_posture", desired, n)
    conditions: Any = law.conditions(seen.view, seen.measured)
    if not isinstance(conditions, dict):
        raise AnswerError(type(law), "conditions", f"returned {described(conditions)}, expected a dict of numbers")
    for name, value in conditions.items():
        if np.ndim(value) or not isinstance(value, (int, float, np.number)):
            raise AnswerError(type(law), "conditions", f"returned {described(value)} as '{name}', expected a number")
