"""A researcher's own laws: the right ones pass, the wrong ones fail with a line that helps, and all are found."""

from __future__ import annotations

import inspect
import re

import numpy as np
import pytest

from phcontrol import (
    CONTROLLERS,
    Controller,
    EnergyShaping,
    Gain,
    InvalidArgumentError,
    LawError,
    PositiveVector,
    Target,
    UnknownNameError,
    Vector,
    certify,
    make_controller,
    register,
    simulate,
)
from phcontrol.analysis.advice import ADVICE
from phcontrol.controllers.registry import all_laws, find_law
from phcontrol.controllers.shaping import EMPTY
from tests.conftest import make_system
from tests.controllers import own_laws
from tests.controllers.own_laws import FAILS, REFUSED, RIGHT, Adapted, ShiftByVelocity, Spring, WithShape


@pytest.fixture(autouse=True)
def registry(monkeypatch):
    monkeypatch.setattr("phcontrol.controllers.registry.CONTROLLERS", CONTROLLERS.copy())


@pytest.mark.parametrize("law", RIGHT)
def test_right_laws_pass(law):
    """With two joints and friction, and on the Panda without."""
    for arm, samples in (("pera_shoulder", 64), ("panda", 16)):
        for form in law.forms:
            system = make_system(arm)
            made = law.tuned(system, system.robot.near_home(), interconnection=form)
            certificate = certify(made, samples=samples)
            assert certificate.passed, str(certificate)


@pytest.mark.parametrize(("law", "line"), FAILS.items(), ids=lambda item: getattr(item, "__name__", ""))
def test_wrong_laws_fail_with_a_line_that_helps(law, line):
    system = make_system("pera_shoulder_elbow")
    certificate = certify(law.tuned(system, [0.3, 0.4, -0.5]), samples=64)
    assert not certificate.passed
    assert not certificate[line].passed, str(certificate)
    assert ADVICE[line] in str(certificate)


@pytest.mark.parametrize(("law", "said"), REFUSED.items(), ids=lambda item: getattr(item, "__name__", ""))
def test_broken_laws_are_refused_with_the_place(law, said):
    """In the file where the law is, in the method that is wrong."""
    complaint, method = said
    certificate = certify(law.tuned(make_system("pera_shoulder"), [0.3, 0.4]), samples=16)
    assert not certificate.passed
    assert re.search(complaint, certificate.error), certificate.error
    file, line, name = re.search(r"\(\S*?(\w+\.py):(\d+), in (\w+)\)", certificate.error).groups()
    assert file == "own_laws.py"
    assert re.fullmatch(method, name)
    if name == "target":
        source, first = inspect.getsourcelines(law.target)
        assert first <= int(line) < first + len(source)
    assert f"FAILED, the law raised {certificate.error}" in str(certificate)


def test_a_matching_residual_names_the_part():
    certificate = certify(own_laws.WrongCoupling.tuned(make_system("pera_shoulder_elbow")), samples=16)
    assert re.search(r"row \d of 6 \('error', entry [123]\)", certificate["matching residual"].where)


def test_no_torque_is_derived_of_a_momentum_that_depends_on_the_velocity(shoulder, rng):
    """Not in a run either, where no certificate is made; with its own shape a law may have such a momentum."""
    law = ShiftByVelocity.tuned(shoulder, [0.3, 0.4])
    x = shoulder.at([0.1, 0.2], [0.3, -0.1])
    with pytest.raises(InvalidArgumentError, match="p̂ − p̄ changes with q̇, by up to 0.029"):
        law.evaluate(0.0, x, EMPTY)
    with pytest.raises(Exception, match="p̂ − p̄ changes with q̇"):
        simulate(shoulder, law, duration=0.01)
    for _ in range(20):  # a θ of position and state passes at any speed
        moving = shoulder.at(rng.normal(size=2), 10.0 * rng.normal(size=2))
        Adapted.tuned(shoulder).evaluate(0.0, moving, rng.normal(size=2))


def test_the_derived_torque_is_the_stated_one(pera, rng):
    derived, stated = Spring.tuned(pera), WithShape.tuned(pera)
    for _ in range(10):
        x = pera.at(pera.robot.random_position(rng), rng.normal(size=7))
        np.testing.assert_allclose(
            derived.evaluate(0.0, x, EMPTY).torque, stated.evaluate(0.0, x, EMPTY).torque, atol=1e-9
        )


def test_registered_laws_are_known_by_their_name():
    system = make_system("pera_shoulder")
    register("mine", Spring, needs="q", options={"damping": 3.0}, minimum_joints=2)
    law = make_controller("mine", system, [0.1, 0.2], stiffness=7.0)
    assert isinstance(law, Spring)
    np.testing.assert_array_equal(law.goal, [0.1, 0.2])
    np.testing.assert_array_equal(law.stiffness, 7.0 * np.eye(2))
    np.testing.assert_array_equal(law.damping, 3.0 * np.eye(2))
    entry = all_laws()[0]["mine"]
    assert (entry.summary, entry.source, entry.needs) == ("A spring and a damper", Spring.__module__, "q")
    assert entry.origin == Spring.__module__
    assert CONTROLLERS["energy_shaping"].origin == "phcontrol"
    again = type("Spring", (EnergyShaping,), {"__module__": Spring.__module__})  # a notebook's cell that is run again
    register("mine", again)
    assert find_law("mine").law is again


class Nameless(Controller):
    goal: Vector = Vector()

    def storage(self, t, x, state, measured=None):
        return 0.0

    def target(self, t, x, state, measured=None):
        return Target(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros((0, 0)))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("energy_shaping", Spring), "name: 'energy_shaping' is taken by EnergyShaping of phcontrol"),
        (("a:b", Spring), "name: must have no colon"),
        (("", Spring), "name: must be a name"),
        (("mine", Nameless), "law: 'Nameless' has no name: give its class a line like"),
        (("mine", Controller), "law: 'Controller' does not state storage, target"),
        (("mine", int), "law: 'int' is no Controller: give the class of a law"),
        (("mine", lambda system: Spring.tuned(system)), "is a function: give the class of a law.*factory"),
        (("mine", "my_laws:Spring"), "law: 'str' is of type str"),
    ],
)
def test_what_cannot_be_registered(arguments, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        register(*arguments)
    assert "mine" not in all_laws()[0]


def test_a_law_that_is_made_cannot_be_registered(shoulder):
    with pytest.raises(InvalidArgumentError, match="is a law that is already made"):
        register("mine", Spring.tuned(shoulder))
    with pytest.raises(UnknownNameError, match="unknown option 'stifness' of mine"):
        register("mine", Spring, options={"stifness": 1.0})
    with pytest.raises(InvalidArgumentError, match="name: of Nameless is missing"):
        Nameless(shoulder, goal=[0.0, 0.0])


def test_a_goal_is_never_dropped_and_a_gain_that_nobody_gives_is_asked_for(shoulder):
    class Bare(Spring):
        goal: Vector = Vector("q_d")
        damping: Gain = Gain("C")

    with pytest.raises(InvalidArgumentError, match="damping: of own_spring has no value for this arm: give one, or"):
        Bare.tuned(shoulder, [0.1, 0.2])
    np.testing.assert_array_equal(Bare.tuned(shoulder, [0.1, 0.2], damping=1.0).goal, [0.1, 0.2])


def test_positive_vectors(shoulder):
    class Held(Spring):
        width: PositiveVector = PositiveVector("w", default=0.2)

    np.testing.assert_array_equal(Held.tuned(shoulder).width, [0.2, 0.2])
    np.testing.assert_array_equal(Held.tuned(shoulder, width=[1, 2]).width, [1.0, 2.0])
    for value, complaint in (
        ([1.0, 0.0], "must be > 0, but its smallest entry is 0"),
        ([1, 2, 3], "shape"),
        ("x", "x"),
    ):
        with pytest.raises(InvalidArgumentError, match=f"width: .*{complaint}"):
            Held.tuned(shoulder, width=value)


MODULE = """
from phcontrol import EnergyShaping

class Stiff(EnergyShaping):
    'Holds a posture, stiffly.'
    name = "stiff"
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a function that makes an installed package of a module and what it offers as laws."""

    def make(name, source, entries):
        (tmp_path / f"{name}.py").write_text(source)
        info = tmp_path / f"{name}-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
        lines = "\n".join(f"{key} = {value}" for key, value in entries.items())
        (info / "entry_points.txt").write_text(f"[phcontrol.controllers]\n{lines}\n")

    monkeypatch.syspath_prepend(str(tmp_path))
    return make


def test_laws_of_installed_packages_are_found(package, shoulder):
    package("stiff_laws", MODULE, {"stiff": "stiff_laws:Stiff"})
    laws, problems = all_laws()
    assert problems == []
    assert laws["stiff"].origin == "stiff_laws 1.2"
    assert laws["stiff"].summary == "Holds a posture, stiffly"
    law = make_controller("stiff", shoulder, [0.1, 0.2])
    assert type(law).__module__ == "stiff_laws"
    assert certify(law, samples=4).passed
    with pytest.raises(UnknownNameError, match=r"unknown controller 'stif'\. Did you mean 'stiff'\?"):
        make_controller("stif", shoulder)


def test_a_package_that_is_broken_does_not_break_the_others(package, shoulder):
    package("good_laws", MODULE, {"good": "good_laws:Stiff"})
    package(
        "bad_laws",
        MODULE + "\nnumber = 3",
        {
            "energy_shaping": "bad_laws:Stiff", "gone": "bad_laws:Gone", "number": "bad_laws:number", "no": "bad_laws",
            "good_too": "good_laws:Stiff",
        },
    )  # fmt: skip
    package("raising_laws", "import numpy\n1 / 0\n", {"raising": "raising_laws:Law", "good_too": "good_laws:Other"})
    laws, problems = all_laws()
    assert laws.keys() - CONTROLLERS.keys() == {"good"}
    text = "\n".join(problems)
    for phrase in (
        "'energy_shaping' of bad_laws 1.2 has the name of a law of phcontrol, which is used",
        "'gone' of bad_laws 1.2: unknown law 'Gone' in bad_laws. Known: Stiff",
        "'number' of bad_laws 1.2: 'bad_laws:number' is of type int",
        "'bad_laws:' must be a module and a class in it",
        "raising_laws.py:2, in <module>: raising_laws:Law raised ZeroDivisionError: division by zero",
        "'good_too' is offered by bad_laws 1.2 (good_laws:Stiff) and raising_laws 1.2 (good_laws:Other): give",
    ):
        assert phrase in text
    assert len(problems) == 6
    assert type(make_controller("energy_shaping", shoulder)) is EnergyShaping
    with pytest.raises(LawError, match="ZeroDivisionError"):
        find_law("raising")
