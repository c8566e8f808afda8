"""Laws with an energy tank in C: what clipped torques do to the tank, what stiffnesses and actions of one's own do."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from phcontrol import (
    INTEGRATORS,
    AdaptivePayload,
    CartesianImpedance,
    CompilationWarning,
    ExternalAction,
    ForceFeedback,
    ForceRegulation,
    ImpedanceGrasping,
    IntegralAction,
    JointSensor,
    MomentumObserver,
    Schedule,
    SimulationError,
    Sine,
    Stiffness,
    certify,
    simulate,
    simulate_many,
    with_tank,
)
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.tanks import Action
from tests.compilation.test_compiled_run import both
from tests.conftest import make_system

pytestmark = pytest.mark.usefixtures("compiler")

CONTROL = {"continuous": {}, "sampled": {"control_period": 1e-3}, "slowly sampled": {"control_period": 2e-3}}


class Push(Action):
    """What pushes a moving arm on."""

    def torque(self, t, x):
        return 0.3 * x.velocity


def stir(t, x):
    return 3.0 * np.cos(x.position + math.sin(t))


LAWS = {
    "an action": lambda arm: with_tank(ForceFeedback).tuned(arm, [0.4, 0.6], actions=Push()),
    "a function": lambda arm: with_tank(IntegralAction).tuned(
        arm, [0.4, 0.6], actions=ExternalAction(stir, duration=1.0)
    ),
    "regulation": lambda arm: with_tank(ImpedanceGrasping).tuned(
        arm, regulation=ForceRegulation([1.0, -1.0]), actions=[Push(), ExternalAction(stir, duration=1.0)]
    ),
}


def clipped(plant, law, **options):
    """Return a compiled run under torque limits, the same as interpreted, in which they change what the tank holds."""
    run = {"v0": np.full(plant.n, 0.3), "duration": 0.15} | options
    free = simulate(plant, law, **run | {"torque_limit": None, "duration": 0.02})
    limit = 0.35 * np.abs(free.torque).max(axis=0) + 0.05
    log = both(plant, law, torque_limit=limit, **run)
    np.testing.assert_allclose(log.tank_level, simulate(plant, law, torque_limit=limit, **run).tank_level, atol=1e-9)
    assert log.saturated.any()
    assert np.abs(log.tank_level[: len(free)] - free.tank_level).max() > 1e-3
    return log


@pytest.mark.parametrize("control", list(CONTROL))
@pytest.mark.parametrize("integrator", list(INTEGRATORS))
@pytest.mark.parametrize("law", list(LAWS))
def test_the_tank_pays_for_what_clipping_does(law, integrator, control, shoulder):
    clipped(shoulder, LAWS[law](shoulder), integrator=integrator, **CONTROL[control])


@pytest.mark.parametrize("law", list(LAWS))
def test_the_tank_counts_with_what_the_law_is_shown(law, shoulder):
    clipped(
        shoulder, LAWS[law](shoulder), **CONTROL["slowly sampled"], torque_delay=3e-3,
        joint_sensor=JointSensor(position_noise=1e-2, velocity_bias=[0.5, -0.5], velocity_noise=0.1, delay=2e-3),
    )  # fmt: skip


def test_what_a_sensor_shows_a_clipped_law_is_what_it_counts_with(shoulder):
    law = with_tank(ForceFeedback).tuned(shoulder, [0.4, 0.6], actions=Push(), measured=True)
    assert law.needs == ("external_force",)
    force = Sine([1.0, 0.5], 1.5)
    clipped(shoulder, law, disturbance=force, sensors=[MomentumObserver(shoulder, 40.0)], control_period=2e-3)
    clipped(shoulder, law, disturbance=force)


def test_laws_in_turn_that_share_a_tank(shoulder):
    first = with_tank(ForceFeedback).tuned(shoulder, [0.4, 0.6], actions=Push())
    laws = Schedule([(0.0, first), (0.05, first.changed(goal=[0.3, 0.5]))])
    clipped(shoulder, laws, control_period=1e-3)


def varied(t):
    return 400.0 + 100.0 * math.sin(3.0 * t) if t < 0.02 else np.array([400.0, 500.0, 600.0])


def turned(t):
    return [[10.0, np.sin(t), 0.0], [np.sin(t), 9.0, 0.0], [0.0, 0.0, 8.0 + math.cos(t)]]


@pytest.fixture(scope="module")
def six():
    return make_system("ur5")


@pytest.mark.parametrize("control", [{}, {"control_period": 1e-3, "dt": 5e-4}])
def test_a_hand_whose_stiffness_changes_and_whose_posture_is_held_by_a_tank(control, six):
    variation = Stiffness(varied, rotational=turned, duration=1.0)
    law = CartesianImpedance.tuned(six, posture="tank", variation=variation)
    near = {"q0": six.robot.near_home(), "duration": 0.04}
    both(six, law, torque_limit=None, **near, **control)
    clipped(six, law, **near, **control)


@pytest.mark.parametrize(
    "stiffness", [lambda t: 500.0 - 30000.0 * t, lambda t: [[500.0, 1e5 * t, 0.0], [1e5 * t, 500.0, 0.0], [0, 0, 9.0]]]
)
def test_a_stiffness_that_becomes_none_is_refused_as_ever(stiffness, six):
    law = CartesianImpedance.tuned(six, variation=Stiffness(stiffness, duration=0.004))
    with (
        pytest.raises(SimulationError, match=r"variation: translational at 0\.0\d+ s: must be positive definite"),
        pytest.warns(CompilationWarning, match="takes a branch that is not compiled"),
    ):
        simulate(six, law, duration=0.05, compiled=True)


def test_what_is_wrong_with_a_stiffness_names_the_time_once():
    with pytest.raises(InvalidArgumentError) as caught:
        Stiffness(lambda t: 500.0 - t, duration=1.0).translational(501.0)
    assert str(caught.value).startswith("variation: translational at 501 s: must be positive definite")
    assert caught.value.name == "variation: translational at 501 s"


class Counting(ForceFeedback):
    """It stops integrating where it is clipped."""

    name = "counting"

    def rate_under_limits(self, t, x, state, rate, change, measured=None):
        return 0.1 * rate


class Sorting(ForceFeedback):
    """It does of clipping what symbols cannot."""

    name = "sorting"

    def rate_under_limits(self, t, x, state, rate, change, measured=None):
        return rate / float(np.linalg.svd(np.eye(2) + np.outer(change, change))[1][0])


def test_a_law_of_ones_own_says_what_clipping_does_to_its_state(shoulder):
    law = Counting.tuned(shoulder, [0.4, 0.6])
    log = both(shoulder, law, torque_limit=2.0, control_period=1e-3)
    assert log.saturated.any()
    other = simulate(shoulder, ForceFeedback.tuned(shoulder, [0.4, 0.6]), duration=0.4, torque_limit=2.0)
    assert np.abs(log.controller_state[-1] - other.controller_state[-1]).max() > 1e-3


def test_what_is_not_traced_of_it_is_said(shoulder):
    law = Sorting.tuned(shoulder, [0.4, 0.6])
    both(shoulder, law, torque_limit=None)
    with pytest.warns(CompilationWarning, match=r"svd has no closed form that is traced \(test_compiled_tanks\.py:"):
        log = simulate(shoulder, law, duration=0.02, torque_limit=2.0, compiled=True)
    np.testing.assert_array_equal(log.position, simulate(shoulder, law, duration=0.02, torque_limit=2.0).position)


def test_an_action_that_is_not_traced_is_said(shoulder):
    law = with_tank(ForceFeedback).tuned(shoulder, actions=ExternalAction(lambda t, x: np.sort(x.velocity).round(1)))
    with pytest.warns(CompilationWarning, match="interpreted: force_feedback_with_tank cannot be compiled: "):
        simulate(shoulder, law, duration=0.02, compiled=True)


def test_a_tank_of_a_law_that_draws_its_own_state(shoulder):
    law = with_tank(AdaptivePayload).tuned(shoulder, actions=Push())
    assert law.random_state(np.random.default_rng(0)).shape == (law.state_size,)
    assert certify(law, samples=8).passed
    clipped(shoulder, law)


@pytest.mark.parametrize("control", [{}, {"control_period": 2e-3}])
def test_many_runs_of_a_tank_under_limits_are_those_by_themselves(control, shoulder):
    base = LAWS["a function"](shoulder)
    laws = [base.changed(stiffness=stiffness) for stiffness in np.linspace(20.0, 60.0, 10)]
    run = {"duration": 0.1, "torque_limit": [2.0, 1.0], "v0": [0.4, -0.3], **control}
    with warnings.catch_warnings():
        warnings.simplefilter("error", CompilationWarning)
        found = simulate_many(shoulder, laws, **run)
    assert all(outcome.compiled for outcome in found)
    for law, outcome in zip(laws, found, strict=True):
        alone = simulate(shoulder, law, compiled=True, **run)
        np.testing.assert_array_equal(outcome.value.position, alone.position)
        np.testing.assert_array_equal(outcome.value.tank_level, alone.tank_level)
        np.testing.assert_allclose(outcome.value.tank_level, simulate(shoulder, law, **run).tank_level, atol=1e-9)
    assert found[0].value.saturated.any()
