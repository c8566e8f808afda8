"""Where floats raise, overflow or are asked what they are, a compiled law orders what the interpreted one does."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest

from phcontrol import Controller, Gain, NotTraceableError, Target, Vector, compile_law
from phcontrol.compilation.arithmetic import BUILT_IN, STAND_INS
from phcontrol.compilation.symbol import TRACING
from phcontrol.compilation.tracing import tracing
from phcontrol.controllers.shaping import Shaping
from phcontrol.exceptions import PHControlError

pytestmark = [
    pytest.mark.usefixtures("compiler"),
    pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value", "ignore:overflow"),
]


class Odd(Controller):
    """A law whose effort beside damping is a formula of time, the error from the goal, and q̇."""

    name = "odd"
    goal: Vector = Vector("q_d", "rad", default=[0.0, 0.0])
    stiffness: Gain = Gain("K_p", "N·m/rad", default=20.0)
    damping: Gain = Gain("C", "N·m·s/rad", default=5.0)

    def storage(self, t, x, state, measured=None):
        return x.kinetic_energy

    def target(self, t, x, state, measured=None):
        error = x.position_error(self.goal)
        return Target.mechanical(
            x, self.interconnection, error=error, gradient=self.stiffness @ error, damping=self.damping
        )

    def shape(self, t, x, state, measured):
        effort = self.formula(t, x.position_error(self.goal), x.velocity) * np.ones(2)
        return Shaping(effort=effort - self.damping @ x.velocity)


def clipped(t, e, v):
    return np.clip(-5.0 * e / np.linalg.norm(e), -3.0, 3.0)


def larger(t, e, v):
    return np.maximum(np.log(np.abs(e)) * e, -1.0)


def largest(t, e, v):
    return (e / e.dot(e) ** 0.5).max(initial=0.25)


def asked_whether_finite(t, e, v):
    quotient = 1.0 / e[0]
    return math.tanh(quotient) if math.isfinite(quotient) else 7.0


def asked_whether_infinite(t, e, v):
    quotient = 1.0 / e[0] ** 2
    return 7.0 if quotient == math.inf else math.tanh(quotient)


def caught_division(t, e, v):
    try:
        return math.tanh(1.0 / float(e[0]))
    except ZeroDivisionError:
        return 7.0


def caught_root(t, e, v):
    try:
        return max(math.sqrt(4.0 - float(e[0]) ** 2), 0.5)
    except ValueError:
        return 7.0


def caught_angle(t, e, v):
    try:
        return math.acos(0.2 * float(e[0])) + math.asin(0.2 * float(e[0]))
    except ValueError:
        return 7.0


def one_of_itself(t, e, v):
    return 3.0 * (e[0] / e[0])


def logarithm_of_a_power(t, e, v):
    return np.minimum(np.log(np.exp(100.0 * v)), 5.0)


def turned_by_a_zero(t, e, v):
    return math.atan2(0.0 - e[0], -1.0 - e[1] ** 2)


def turned_by_a_negative_zero(t, e, v):
    return np.arctan2(e + 0.0, -1.0 - e**2)


def direction(t, e, v):
    h = np.hypot(v[0], v[1])
    return -3.0 * v / h if h > 0.0 else 0.0 * v


def remainder(t, e, v):
    return 10.0 * (t % 0.1) + 3.0 * ((e[0] - 2.0) % -0.3)


def indefinite(t, e, v):
    a = e[0] ** 2
    return np.linalg.solve(np.array([[a, 1.0], [1.0, 1.0 + 1e4]]), np.array([1.0, 2.0]))


def whole(t, e, v):
    return np.array(10.0 * v, dtype=int) if v[0] > 50.0 else v


def some(t, e, v):
    return np.max(np.abs(v), where=np.array([False, True]), initial=0.0) if v[0] > 50.0 else v


STILL, AT_GOAL, FAR = (0.0, [0.1, 0.2], [0.0, 0.0]), (0.0, [0.0, 0.0], [0.1, -0.2]), (0.0, [11.0, 0.3], [0.1, -0.2])
SMALL = (0.0, [0.1, 0.2], [1e-162, 2e-162])
FAST = [(0.0, [0.1, 0.2], [8.0, 0.3]), (0.0, [0.1, 0.2], [-8.0, 0.3])]


@pytest.mark.parametrize(
    ("formula", "states"),
    [
        (clipped, [AT_GOAL]),
        (larger, [AT_GOAL]),
        (largest, [AT_GOAL]),
        (asked_whether_finite, [AT_GOAL]),
        (asked_whether_infinite, [AT_GOAL]),
        (caught_division, [AT_GOAL]),
        (caught_root, [FAR]),
        (caught_angle, [FAR]),
        (one_of_itself, [AT_GOAL]),
        (logarithm_of_a_power, FAST),
        (turned_by_a_zero, [AT_GOAL]),
        (turned_by_a_negative_zero, [(0.0, [-0.0, 0.0], [0.0, 0.0])]),
        (direction, [STILL, SMALL]),
        (remainder, [(t, [q, 0.0], [0.0, 0.0]) for t in (1.0, 0.3, 0.7, -0.3) for q in (0.0, 0.5, 2.0, 2.3)]),
        (indefinite, [(0.0, [q, 0.0], [0.0, 0.0]) for q in (1e-4, 1e-7, 0.0)]),
        (whole, [(0.0, [0.0, 0.0], [50.77, 0.3])]),
        (some, [(0.0, [0.0, 0.0], [50.77, 0.3])]),
    ],
)
def test_the_same_torque_or_the_same_error(formula, states, shoulder):
    law = Odd.tuned(shoulder)
    law.formula = formula
    compiled = compile_law(law)
    assert compiled.report.covered > 0.3
    for t, q, v in states:
        q, v = np.array(q), np.array(v)
        try:
            expected = law.evaluate(t, shoulder.at(q, v), np.zeros(0)).torque
        except (PHControlError, ZeroDivisionError, ValueError) as error:
            with pytest.raises(type(error)):
                compiled.step(t, q, v, np.zeros(0))
        else:
            np.testing.assert_allclose(compiled.step(t, q, v, np.zeros(0)).torque, expected, rtol=1e-10, atol=1e-12)


def swallowing(make):
    def formula(t, e, v):
        try:
            return make(t, e, v)
        except Exception:
            return 0.0

    return formula


@pytest.mark.parametrize(
    "make",
    [
        lambda t, e, v: {"0.5": 9.0}.get(str(t), 0.0),
        lambda t, e, v: {"0.5": 9.0}.get(f"{t}", 0.0),
        lambda t, e, v: {"0.5": 9.0}.get(repr(t), 0.0),
        lambda t, e, v: 10.0 if t in {0.25, 0.5} else 0.0,
        lambda t, e, v: {40: 9.0}.get(math.floor(10 * e[0]), 1.0),
        lambda t, e, v: [1.0, 2.0, 3.0][int(abs(v[0])) % 2],
        lambda t, e, v: round(v[0], 1),
        lambda t, e, v: v[0] // 0.1,
        lambda t, e, v: np.nan_to_num(e / np.linalg.norm(e)),
        lambda t, e, v: np.cosh(v) / np.cosh(v),
        lambda t, e, v: np.copysign(0.0, e),
        lambda t, e, v: v.astype(int) * 1e-30,
        lambda t, e, v: np.array(v, dtype=np.float32) * 1e-30,
    ],
)  # fmt: skip
@pytest.mark.parametrize("caught", [False, True])
def test_what_would_lose_the_expression_is_refused_also_when_the_law_catches_it(make, caught, shoulder):
    law = Odd.tuned(shoulder)
    law.formula = swallowing(make) if caught else make
    with pytest.raises(NotTraceableError, match=r"odd cannot be compiled: .*test_exact.py:\d+"):
        compile_law(law)


def test_other_threads_get_plain_functions_while_one_traces():
    """Also where a dtype is given by its place, or a ufunc is asked for more than to be called."""
    np_, found = STAND_INS[0][1], []

    def ask():
        assert threading.get_ident() not in TRACING
        made = [
            np_.zeros(2, BUILT_IN["float"]),
            np_.ones(2, BUILT_IN["float"]),
            np_.full(2, 3.0),
            np_.array([1, 2], BUILT_IN["float"]),
            np_.empty(2),
        ]
        made += [
            np_.zeros_like(np.ones(2)),
            np.asarray([1, 2], dtype=BUILT_IN["float"]),
            np.ones(2, int).astype(BUILT_IN["float"]),
        ]
        found.append([type(array) is np.ndarray and array.dtype == np.float64 for array in made])
        found.append([np_.maximum.reduce([1.0, 3.0]) == 3.0, np_.clip(np.ones(2), max=0.5)[0] == 0.5])
        found.append([np_.linalg.norm(np.ones((2, 2)), axis=0).shape == (2,), np_.nan_to_num(np.nan) == 0.0])

    with tracing([]):
        thread = threading.Thread(target=ask)
        thread.start()
        thread.join()
        assert np_.zeros(2, BUILT_IN["float"]).dtype == object  # and here symbols find room
    assert [all(answers) for answers in found] == [True] * 3
