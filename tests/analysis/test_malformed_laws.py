"""Laws whose methods answer with something else than they are asked for: what is said names class and method."""

from __future__ import annotations

import re

import numpy as np
import pytest

from phcontrol import AnswerError, EnergyShaping, InvalidArgumentError, UnknownNameError, certify, simulate
from phcontrol.runtime.measured_borders import MeasuredBorders
from tests.analysis.test_red_team import replaced
from tests.conftest import make_system


def answering(method, answer):
    """Return MyLaw, of which a method answers otherwise, at rest or always."""

    def asked(self, *arguments):
        return answer(getattr(super(law, self), method)(*arguments), *arguments)

    law = type("MyLaw", (EnergyShaping,), {method: asked})
    law.__module__ = "my_laws"
    return law


def at_rest(wrong_answer):
    return lambda right, t, x, *others: right if x.velocity.any() else wrong_answer(right)


MALFORMED = {
    (
        "storage",
        lambda right, *asked: np.ones(2),
    ): r"storage returned an array of shape \(2,\), expected a number \[J\]",
    ("storage", lambda right, *asked: None): "storage returned None, expected a number",
    ("storage", lambda right, *asked: "1"): "storage returned '1', expected a number",
    ("storage", lambda right, *asked: 1j): "storage returned 1j, expected a number",
    ("storage", at_rest(lambda right: np.nan)): r"storage returned nan, expected a finite number \[J\], .*, q̇ = 0",
    ("evaluate", at_rest(lambda right: right._replace(torque=right.torque * np.nan))): (
        r"evaluate returned a torque that is not finite, \[nan nan\], at t = 0 s, q = .*, q̇ = 0"
    ),
    ("evaluate", lambda right, *asked: right._replace(torque=right.torque[:1])): (
        r"evaluate returned an array of shape \(1,\) as torque, expected an array of shape \(2,\)"
    ),
    ("evaluate", lambda right, *asked: right._replace(torque=list(right.torque))): "evaluate returned .* as torque",
    ("evaluate", lambda right, *asked: right.torque): r"evaluate returned an array of shape \(2,\), expected a Command",
    ("evaluate", lambda right, *asked: right._replace(state_rate=np.ones(1))): (
        r"evaluate returned an array of shape \(1,\) as state_rate, expected an array of shape \(0,\)"
    ),
    ("target", lambda right, *asked: None): "target returned None, expected a Target",
    ("target", at_rest(lambda right: replaced(right, gradient=right.gradient * np.nan))): (
        "target returned a Target whose gradient must be finite"
    ),
    ("target", lambda right, *asked: replaced(right, gradient=right.gradient[:1])): (
        r"target returned a Target whose gradient must have shape \(4,\), but has shape \(1,\)"
    ),
    ("coordinates", lambda right, *asked: right[:1]): (
        r"coordinates returned an array of shape \(1,\), expected an array of shape \(4,\)"
    ),
    ("shape", lambda right, *asked: None): "shape returned None, expected a Shaping",
    ("initial_state", lambda right, *asked: np.ones(3)): r"initial_state returned an array of shape \(3,\), expected",
    ("rest_posture", lambda right, *asked: None): r"rest_posture returned None, expected an array of shape \(2,\)",
    ("target_posture", lambda right, *asked: np.ones(3)): r"target_posture returned an array of shape \(3,\)",
    ("desired_posture", lambda right, *asked: np.ones(3)): r"desired_posture returned an array of shape \(3,\)",
    ("passive_port", lambda right, *asked: (1.0, 2.0)): r"passive_port returned \(1.0, 2.0\), expected a PassivePort",
    ("passive_port", lambda right, *asked: right._replace(output=np.ones(3))): (
        r"passive_port returned an array of shape \(3,\) as output"
    ),
    ("conditions", lambda right, *asked: [1.0]): r"conditions returned \[1.0\], expected a dict of numbers",
    ("conditions", lambda right, *asked: {"a": np.ones(2)}): r"conditions returned an array of shape \(2,\) as 'a'",
    ("calmest_state", lambda right, *asked: np.ones(3)): "calmest_state returned an array",
    ("jump", lambda right, *asked: np.ones(3)): "jump returned an array",
    ("rate_under_limits", lambda right, *asked: np.ones(3)): "rate_under_limits returned an array",
    ("reference_velocity", lambda right, *asked: np.ones(3)): "reference_velocity returned an array",
    ("rest_force", lambda right, *asked: np.ones(3)): "rest_force returned an array",
}


@pytest.mark.parametrize(("method", "answer", "words"), [(*key, words) for key, words in MALFORMED.items()])
def test_malformed_answers_are_named_by_class_and_method(method, answer, words):
    certificate = certify(answering(method, answer).tuned(make_system("pera_shoulder")), samples=1)
    assert not certificate.passed
    assert f"AnswerError: MyLaw.{method} " in certificate.error
    assert re.search(f"MyLaw.{words}", certificate.error), certificate.error


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("states", "pull", r"MyLaw.states is 'pull', expected a tuple of names"),
        ("phases", (), r"MyLaw.phases is \(\), expected a tuple of times"),
        ("time_span", "long", r"MyLaw.time_span is 'long', expected a number \[s\]"),
        ("driven_by", True, "MyLaw.driven_by is True, expected a str"),
        ("caveat", None, "MyLaw.caveat is None, expected a str"),
    ],
)
def test_malformed_words_are_named_too(name, value, words):
    law = type("MyLaw", (EnergyShaping,), {name: value}).tuned(make_system("pera_shoulder"))
    assert re.search(words, certify(law, samples=1).error)


@pytest.mark.parametrize(
    ("needs", "error", "words"),
    [
        (
            "external_force",
            InvalidArgumentError,
            "MyLaw.needs: must be a tuple of names of 'external_force'",
        ),
        (["external_force"], InvalidArgumentError, r"must be a tuple .* but is \['external_force'\]"),
        (None, InvalidArgumentError, "must be a tuple .* but is None"),
        ((1,), InvalidArgumentError, r"must be a tuple .* but is \(1,\)"),
        (("external_forces",), UnknownNameError, "in MyLaw.needs. Did you mean 'external_force'[?] Known: .*features"),
    ],
)
def test_needs_that_are_none_are_refused(needs, error, words):
    law = type("MyLaw", (EnergyShaping,), {"needs": needs}).tuned(make_system("pera_shoulder"))
    uses = (
        lambda: certify(law, samples=1),
        lambda: simulate(law.system, law, duration=0.01),
        lambda: MeasuredBorders(law, law.system.robot),  # of a control loop
    )
    for use in uses:
        with pytest.raises(error, match=words):
            use()


def test_an_answer_that_is_wrong_has_a_name_for_programs():
    error = AnswerError(EnergyShaping, "storage", "returned None, expected a number [J]")
    assert str(error) == "EnergyShaping.storage returned None, expected a number [J]"
    assert error.name == "storage"
