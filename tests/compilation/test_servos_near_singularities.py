"""Servo laws in C where the image Jacobian loses rank: one way through what is damped there, and none falls back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from phcontrol import ExternalAction, HamiltonianServo, Measured, compile_law, make_controller, with_tank
from tests.conftest import make_system

pytestmark = pytest.mark.usefixtures("compiler")

DISTANCES = (3.0, 1.2, 0.9, 0.5, 0.1, 1e-2, 1e-4, 1e-6, 0.0)
"""σ/ε."""


@pytest.fixture(scope="module")
def pera():
    return make_system("pera")


def postures(law, features, generator):
    """Return postures whose σ is about so much of ε as DISTANCES say, and their σ/ε."""
    arm, damping = law.system, law.damping_of_singularities

    def distance(q):
        B = law.view(arm.at(q), features).image_jacobian
        return damping.distance(B @ B.T) / damping.region

    options = {"maxiter": 1500, "fatol": 1e-10, "xatol": 1e-10}
    starts = [arm.robot.random_position(generator) for _ in range(3)]
    found = [minimize(distance, start, method="Nelder-Mead", options=options) for start in starts]
    singular, away = min(found, key=lambda one: one.fun).x, generator.normal(size=arm.n)
    for wanted in DISTANCES:
        low, high = 0.0, 1.0
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if distance(singular + middle * away) < wanted else (low, middle)
        yield singular + low * away, distance(singular + low * away)


SERVOS = {
    "even": lambda arm: make_controller("hamiltonian_servo", arm),
    "a rate that is not symmetric": lambda arm: make_controller("hamiltonian_servo", arm).changed(
        rate=[[2.0, 0.3, 0.0], [-0.2, 1.5, 0.1], [0.0, 0.2, 3.0]]
    ),
    "with a tank": lambda arm: with_tank(HamiltonianServo).tuned(
        arm, actions=ExternalAction(lambda t, x: 0.1 * np.cos(x.position))
    ),
    "no posture": lambda arm: make_controller("hamiltonian_servo", arm).changed(posture_gain=0.0),
}


def check(law, seeds):
    """Check that C answers at every distance, and answers as the law does: closer to it than what cancels there."""
    compiled = compile_law(law)
    assert compiled.report.ways == 1
    features, damped = law.goal + np.array([1e-4, -2e-4, 1e-4]), 0
    asked = compiled.step.counts
    for seed in seeds:
        generator = np.random.default_rng(seed)
        reached = []
        for q, distance in postures(law, features, generator):
            x, state = law.system.at(q, 0.5 * generator.normal(size=law.system.n)), np.zeros(law.state_size)
            shown = Measured(features=features)
            answer, expected = (asks(0.0, x, state, shown) for asks in (compiled.evaluate, law.evaluate))
            for one, other in zip(answer, expected, strict=True):
                size = max(1.0, float(np.abs(other).max(initial=0.0)))
                np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9 * size, err_msg=f"σ/ε = {distance}")
            reached.append(distance)
            damped += law.damping_of_singularities.at(_square(law, x, features)) is not None
        assert min(reached) < 1e-5  # where N is not defined
    assert damped >= 6 * len(seeds)
    assert compiled.step.counts[0] - asked[0] == len(DISTANCES) * len(seeds)
    assert compiled.step.counts[1] == 0


def _square(law, x, features):
    B = law.view(x, features).image_jacobian
    return B @ B.T


@pytest.mark.parametrize("servo", list(SERVOS))
def test_a_servo_has_one_way_through_singular_postures(servo, pera):
    check(SERVOS[servo](pera), [0, 1])


@pytest.mark.study
@pytest.mark.parametrize("arm", ["pera", "panda"])
def test_in_the_canonical_form_too(arm):
    check(make_controller("hamiltonian_servo", make_system(arm), interconnection="canonical"), [0])
