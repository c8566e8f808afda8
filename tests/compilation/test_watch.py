"""What is changed after a law was compiled is noticed, and what differs from call to call is refused."""

from __future__ import annotations

import random
import time

import numpy as np
import pytest

from phcontrol import (
    CompilationError,
    CompilationWarning,
    EnergyShaping,
    ForceFeedback,
    NotTraceableError,
    StribeckFriction,
    compile_law,
    make_controller,
    simulate,
)
from phcontrol.compilation import _plain_caller, caller
from phcontrol.compilation import compiled_law as compiled_law_module
from tests.conftest import make_system

pytestmark = pytest.mark.usefixtures("compiler")

GAIN = 1.0
TABLE = np.array([1.0, 2.0])


def cell_law():
    share = 1.0
    weights = np.array([[1.0, 0.5], [0.5, 1.0]]).T[:, ::-1]

    class OfACell(EnergyShaping):
        name = "of_a_cell"

        def shape(self, t, x, state, measured):
            shaping = super().shape(t, x, state, measured)
            return shaping._replace(effort=share * weights.dot(shaping.effort))

    def change(value):
        nonlocal share
        share = value

    return OfACell, change, weights


class Changing(EnergyShaping):
    """A law with numbers in all places that are watched."""

    name = "changing"
    factor = 1.0

    def prepare(self):
        super().prepare()
        self.boost, self.table, self.list = 1.0, np.array([1.0, 2.0]), [1.0, 0.5]
        self.named = {"a": 2.0}

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        scale = self.boost * self.table * GAIN * TABLE * self.factor * self.list[0] * self.named["a"]
        return shaping._replace(effort=scale * shaping.effort)


def item(thing, place, value):
    thing[place] = value


CHANGES = {
    "attribute": lambda law, monkeypatch: monkeypatch.setattr(law, "boost", 4.0),
    "array": lambda law, monkeypatch: item(law.table, 1, 9.0),
    "list": lambda law, monkeypatch: item(law.list, 0, 3.0),
    "dict": lambda law, monkeypatch: item(law.named, "a", 3.0),
    "deleted": lambda law, monkeypatch: law.__dict__.pop("boost"),
    "global number": lambda law, monkeypatch: monkeypatch.setitem(globals(), "GAIN", 2.0),
    "global array": lambda law, monkeypatch: item(TABLE, 0, 3.0),
    "class": lambda law, monkeypatch: monkeypatch.setattr(Changing, "factor", 2.0),
}


@pytest.fixture(autouse=True)
def restored():
    yield
    TABLE[:] = 1.0, 2.0


@pytest.mark.parametrize("which", [caller.Caller, _plain_caller.Caller], ids=["C", "ctypes"])
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_what_is_changed_after_compilation_is_noticed(change, which, shoulder, monkeypatch):
    monkeypatch.setattr(compiled_law_module, "Caller", which)
    law = Changing.tuned(shoulder, goal=[0.4, 0.6])
    compiled, x = compile_law(law), shoulder.at([0.1, 0.2], [0.3, -0.1])
    np.testing.assert_allclose(compiled.evaluate(0.0, x, np.zeros(0)).torque, law.evaluate(0.0, x, np.zeros(0)).torque)
    change(law, monkeypatch)
    for _ in range(2):
        with pytest.raises(CompilationError, match=r"changing was changed after it was compiled .*compile it again"):
            compiled.evaluate(0.0, x, np.zeros(0))
        with pytest.raises(CompilationError, match="was changed after it was compiled"):
            compiled.step(0.0, x.position, x.velocity, np.zeros(0))


def test_numbers_of_the_compiled_law_itself_are_watched(shoulder):
    compiled, x = compile_law(Changing.tuned(shoulder, goal=[0.4, 0.6])), shoulder.at([0.1, 0.2])
    compiled.boost = 1.0 + 1e-9
    with pytest.raises(CompilationError, match="'boost' is not what it was"):
        compiled.evaluate(0.0, x, np.zeros(0))


def test_closures_and_arrays_with_strides_are_watched(shoulder):
    law, change, weights = cell_law()
    for alter in (lambda: change(2.0), lambda: item(weights, (0, 1), 7.0)):
        compiled, x = compile_law(law.tuned(shoulder, goal=[0.4, 0.6])), shoulder.at([0.1, 0.2])
        compiled.evaluate(0.0, x, np.zeros(0))
        alter()
        with pytest.raises(CompilationError, match="was changed after it was compiled"):
            compiled.evaluate(0.0, x, np.zeros(0))


def test_a_change_in_a_loop_that_python_has_specialised_is_noticed(shoulder):
    """Between steps that find nothing an attribute is set to what it is, a hundred times, and then to another."""
    law = Changing.tuned(shoulder, goal=[0.4, 0.6])
    compiled, x = compile_law(law), shoulder.at([0.1, 0.2])
    kept, other = law.boost, 1.0 + 1e-9
    for value in [kept] * 100 + [other]:
        compiled.step(0.0, x.position, x.velocity, np.zeros(0))
        law.boost = value
    assert compiled.step.counts[1] == 0
    with pytest.raises(CompilationError, match="'boost' is not what it was"):
        compiled.step(0.0, x.position, x.velocity, np.zeros(0))
    law.boost = kept
    compiled.step(0.0, x.position, x.velocity, np.zeros(0))


def test_the_plant_is_watched(monkeypatch):
    system = make_system("pera_shoulder")
    compiled, x = compile_law(make_controller("force_feedback", system)), system.at([0.1, 0.2])
    compiled.step(0.0, x.position, x.velocity, np.zeros(compiled.state_size))
    monkeypatch.setattr(system, "friction", StribeckFriction(viscous=5.0))  # the tests share it
    with pytest.raises(CompilationError, match="'friction' is not what it was"):
        compiled.step(0.0, x.position, x.velocity, np.zeros(compiled.state_size))


def test_what_is_computed_on_first_use_is_no_change(shoulder):
    law = make_controller("force_feedback", shoulder)
    compiled, x = compile_law(law), shoulder.at([0.1, 0.2])
    for thing in (law, compiled):
        thing.storage(0.0, x, np.zeros(thing.state_size))
        thing.rest_posture(0.0)
    for _ in range(3):
        compiled.step(0.0, x.position, x.velocity, np.zeros(compiled.state_size))
    assert compiled.step.counts[1] == 0


def reading(what):
    class Reading(ForceFeedback):
        name = "reading"

        def shape(self, t, x, state, measured):
            shaping = super().shape(t, x, state, measured)
            return shaping._replace(effort=shaping.effort + 0.0 * what())

    return Reading


DICE = np.random.default_rng(0)


class Clocked(ForceFeedback):
    name = "clocked"

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=shaping.effort * (1.0 if time.monotonic() else 2.0))


class Thrown(ForceFeedback):
    name = "thrown"

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=shaping.effort + 1e-12 * DICE.normal())


@pytest.mark.parametrize(
    ("law", "name"),
    [(Clocked, "time"), (Thrown, "DICE"), (reading(time.time), "what"), (reading(random.random), "what")],
)
def test_clocks_and_dice_are_refused_by_name(law, name, shoulder):
    """By a run in C too, which would have them as they were when it was made."""
    made, words = law.tuned(shoulder, goal=[0.4, 0.6]), f"it reads '{name}', a clock or a random generator"
    with pytest.raises(NotTraceableError, match=words):
        compile_law(made)
    with pytest.warns(CompilationWarning, match=words):
        simulate(shoulder, made, duration=0.002, compiled=True)


def test_a_force_by_the_clock_is_refused_in_runs(shoulder):
    law = make_controller("energy_shaping", shoulder)
    with pytest.warns(CompilationWarning, match="what acts on the arm cannot be compiled: it reads 'time', a clock"):
        simulate(shoulder, law, duration=0.002, compiled=True, disturbance=lambda t, x: time.time() // 1e6 * np.ones(2))


def test_the_callers_in_c_take_only_what_they_can_read():
    if caller.Caller is _plain_caller.Caller:
        pytest.skip("the caller in C was not built")
    for watched in ((), ([], [], []), ([1], [], [], []), ([({}, ("a",), ())], [], [], []), ([], [], [(1, 2)], [])):
        with pytest.raises((TypeError, ValueError), match="watched"):
            caller.Caller(0, 1, 0, (0, 0, 0), np.zeros(1), max, tuple, None, watched)
