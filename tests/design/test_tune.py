"""Tuning makes an objective smaller, stays with stable gains, and does the same each time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phcontrol import (
    EnergyShaping,
    InvalidArgumentError,
    MechanicalSystem,
    PHControlError,
    Sweep,
    UnknownNameError,
    linearize,
    load_robot,
    make_controller,
    simulate,
    tune,
)
from tests.controllers.arms import chain


@pytest.fixture(scope="module")
def shoulder():
    return MechanicalSystem(load_robot("pera_shoulder"))


def test_it_finds_the_optimum_that_is_known():
    """One joint, x'' + c x' + x = 0 from rest: ∫x² dt = (c + 1/c)/2 is least at c = 1, ζ = ½."""
    system = chain(1)
    M = float(system.at([0.0]).mass_matrix[0, 0])
    law = EnergyShaping(system, goal=[0.0], stiffness=M, damping=0.4 * M)
    scenario = {"q0": [0.01], "duration": 20.0, "dt": 0.05, "torque_limit": None}

    def square(log):
        return float(np.sum(log.position**2))

    found = tune(law, square, [scenario], gains=["damping"], evaluations=25)
    assert found.law.damping[0, 0] / M == pytest.approx(1.0, rel=0.02)
    assert found.value / found.start_value == pytest.approx((1.0 + 1.0) / (0.4 + 1.0 / 0.4), rel=0.01)
    assert found.converged


def test_it_does_the_same_each_time_and_remembers(shoulder):
    begun = make_controller("energy_shaping", shoulder).stiffness[0, 0]

    def run(law, scenario):
        factor = float(law.stiffness[0, 0]) / begun
        return scenario * factor + 1.0 / factor

    for method in ("nelder-mead", "evolution"):
        first, second = (
            tune("energy_shaping", float, iter([1.0, 2.0]), system=shoulder, run=run, method=method, evaluations=40)
            for _ in range(2)
        )
        assert first.history == second.history
        assert first.value == min(trial.value for trial in first.history)
        assert len(first.history) <= 40
        assert first.law.stiffness[0, 0] / begun == pytest.approx(1.5**-0.5, rel=0.15)  # of the mean over both
    worst = tune("energy_shaping", float, [1.0, 2.0], system=shoulder, run=run, combine="max", evaluations=60)
    assert worst.law.stiffness[0, 0] / begun == pytest.approx(2.0**-0.5, rel=0.02)


def test_gains_whose_loop_is_unstable_are_not_even_run(shoulder):
    """What pays for stiffness without end: with a period it stops where the sampled loop does."""
    asked = []

    def run(law, scenario):
        asked.append(law)
        return -float(law.stiffness[0, 0] + law.damping[0, 0])

    found = tune(
        "energy_shaping", lambda value: value + 1e6, [0], system=shoulder, run=run, bounds=(0.1, 1e4), period=4e-3,
        evaluations=120,
    )  # fmt: skip
    assert found.refused
    assert all("not stable" in trial.reason for trial in found.refused)
    assert all(math.isinf(trial.value) for trial in found.refused)
    assert len(asked) == len(found.history) - len(found.refused)
    assert linearize(found.law, shoulder).sampled(4e-3, 1).stable
    assert found.value < found.start_value


def test_a_factor_for_each_joint(shoulder):
    desired = make_controller("energy_shaping", shoulder).stiffness.diagonal() * np.array([3.0, 0.4])

    def run(law, scenario):
        return float(np.sum(np.log(law.stiffness.diagonal() / desired) ** 2))

    found = tune(
        "energy_shaping", float, [0], system=shoulder, run=run, gains=["stiffness"], per_joint=True, evaluations=100
    )
    np.testing.assert_allclose(found.law.stiffness.diagonal(), desired, rtol=0.05)
    assert len(found.factors["stiffness"]) == 2


def test_runs_that_fail_are_refused_and_not_the_end(shoulder):
    begun = make_controller("energy_shaping", shoulder).stiffness[0, 0]

    def run(law, scenario):
        if law.stiffness[0, 0] > 1.2 * begun:
            raise PHControlError("diverged")
        return float(law.stiffness[0, 0])

    found = tune("energy_shaping", lambda value: 100.0 - value, [0], system=shoulder, run=run, evaluations=40)
    assert found.refused
    assert begun < found.law.stiffness[0, 0] <= 1.2 * begun
    nan = tune("energy_shaping", lambda value: math.nan if value > begun else -value, [0], system=shoulder,
               run=lambda law, scenario: float(law.stiffness[0, 0]), evaluations=12)  # fmt: skip
    assert "the objective is not finite" in {trial.reason for trial in nan.refused}


def test_what_makes_no_sense_is_refused(shoulder):
    law = make_controller("energy_shaping", shoulder)

    def nothing(log):
        return 0.0

    with pytest.raises(InvalidArgumentError, match="over: has no scenarios"):
        tune(law, nothing, [])
    with pytest.raises(UnknownNameError, match="unknown gain 'stifness'"):
        tune(law, nothing, [{}], gains=["stifness"])
    with pytest.raises(InvalidArgumentError, match="bounds: must be two factors"):
        tune(law, nothing, [{}], bounds=(2.0, 3.0))
    with pytest.raises(InvalidArgumentError, match="system: must be given"):
        tune("energy_shaping", nothing, [{}])
    with pytest.raises(InvalidArgumentError, match="begins with gains that are refused: over: must hold dictionaries"):
        tune(law, nothing, [3.0])
    with pytest.raises(InvalidArgumentError, match="begins with gains that are refused"):
        tune(law, nothing, [{"duration": 0.1}], period=10.0)


SWEEP = {
    "arm": {"robot": "pera_shoulder", "friction": {"viscous": 0.5}},
    "law": {"name": "energy_shaping", "goal": [0.3, 0.5]},
    "run": {"duration": 0.3, "dt": 2e-3},
    "vary": {"payload_mass": {"uniform": [0.0, 0.5]}, "initial_offset.each": {"uniform": [-0.2, 0.2]}},
    "sampling": {"method": "random", "runs": 4, "seed": 3},
    "measures": ["final_error"],
}


def test_it_tunes_over_the_runs_of_a_sweep():
    """Each trial has the runs of the sweep, drawn once; the value of the best is that of its law simulated by hand."""
    sweep = Sweep(**SWEEP)

    def error(log):
        return float(np.abs(log.position[-1] - [0.3, 0.5]).max())

    found = tune(sweep.nominal.law, error, sweep, evaluations=12)
    assert found.value < 0.8 * found.start_value
    by_hand = [error(simulate(**(sweep.loop(run) | {"controller": found.law}))) for run in range(4)]
    assert found.value == pytest.approx(np.mean(by_hand), rel=1e-9)
    begun = [error(sweep.replay(run)) for run in range(4)]
    assert found.start_value == pytest.approx(np.mean(begun), rel=1e-9)


def test_a_sweep_of_gains_or_of_another_law_is_refused(shoulder):
    gains = Sweep(**(SWEEP | {"vary": {"gain_factor.stiffness": {"uniform": [0.5, 2.0]}}}))
    with pytest.raises(InvalidArgumentError, match="over: varies gains of the law"):
        tune(gains.nominal.law, float, gains)
    with pytest.raises(InvalidArgumentError, match="is of energy_shaping on pera_shoulder, and what is tuned is force"):
        tune("force_feedback", float, Sweep(**SWEEP), system=shoulder)


def test_a_sweep_of_one_run_is_tuned_over_too():
    sweep = Sweep(**(SWEEP | {"sampling": {"method": "random", "runs": 1, "seed": 3}}))
    law, asked = sweep.nominal.law, []

    def run(law, scenario):
        asked.append(scenario)
        return 1.0

    tune(law, float, sweep, run=run, evaluations=2)
    assert len(asked) == 2
    np.testing.assert_array_equal(asked[0]["q0"], sweep.loop(0)["q0"])


def test_every_evaluation_that_is_allowed_is_used(shoulder):
    for evaluations in (2, 3, 5):
        found = tune("energy_shaping", float, [0], system=shoulder, run=lambda law, _: float(law.stiffness[0, 0]),
                     evaluations=evaluations)  # fmt: skip
        assert len(found.history) == evaluations
        assert not found.converged


def test_a_steep_objective_is_followed_to_its_end(shoulder):
    """|log(k/2k₀)| times a thousand: the factors' tolerance alone would leave off at a thousandth."""
    begun = make_controller("energy_shaping", shoulder).stiffness[0, 0]

    def run(law, scenario):
        return 1e3 * abs(math.log(law.stiffness[0, 0] / begun / 2.0))

    found = tune("energy_shaping", float, [0], system=shoulder, run=run, gains=["stiffness"], evaluations=100)
    assert found.converged
    assert found.value < 1e-4 * found.start_value


def test_gains_of_the_hand_have_one_factor_and_none_a_joint():
    law = make_controller("cartesian_impedance", MechanicalSystem(load_robot("ur5")))
    found = tune(law, float, [0], run=lambda law, _: float(law.translational_stiffness[0, 0]), evaluations=2)
    assert len(found.factors["translational_stiffness"]) == 1
    with pytest.raises(UnknownNameError, match="unknown gain 'translational_stiffness'"):
        tune(law, float, [0], run=lambda law, _: 1.0, gains=["translational_stiffness"], per_joint=True)
