"""Gradients of tuning are those of differences, are used where they are to be had, and save runs."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    CompilationError,
    CompilationWarning,
    ForceSensor,
    InvalidArgumentError,
    JointSensor,
    LogSlopes,
    MechanicalSystem,
    QuadraticCost,
    SmoothObjective,
    Sweep,
    load_robot,
    make_controller,
    simulate,
    tune,
)
from phcontrol._differences import central_difference
from phcontrol.compilation.compiler import find_compiler
from phcontrol.design import gain_search
from phcontrol.simulation.sensitivity import gradient_along
from tests.design.test_tune import SWEEP

pytest.importorskip("casadi")
if find_compiler() is None:
    pytest.skip("no C compiler", allow_module_level=True)


@pytest.fixture(scope="module")
def panda():
    return MechanicalSystem(load_robot("panda"))


@pytest.fixture(scope="module")
def shoulder():
    return MechanicalSystem(load_robot("pera_shoulder"))


def scaled(law, name):
    return lambda h: law.changed(**{name: np.exp(h) * getattr(law, name)})


def off(system, name, gains, cost, step=1e-3, **run):
    """By how much the gradient differs from differences of the interpreted run, over the largest slope."""
    law = make_controller(name, system, system.robot.near_home())
    arguments = {"system": system, "controller": law, "duration": 0.1, "dt": 1e-3} | run
    log = simulate(**arguments)
    directions = [scaled(law, gain) for gain in gains]
    found = gradient_along(arguments, log, cost.slopes(log), directions)
    expected = np.array(
        [
            central_difference(lambda h, made=made: cost(simulate(**(arguments | {"controller": made(h)}))), step)
            for made in directions
        ]
    )
    assert np.abs(expected).min() > 0.0
    return float(np.abs(found - expected).max() / np.abs(expected).max()), log


@pytest.mark.parametrize("name", ["energy_shaping", "force_feedback"])
@pytest.mark.parametrize("run", [{}, {"control_period": 2e-3}, {"integrator": "semi_implicit_euler"}])
def test_it_is_that_of_differences_on_a_panda(panda, name, run):
    goal = panda.robot.near_home()
    start = goal + 0.2 * np.cos(np.arange(8.0))
    cost = QuadraticCost(goal, velocity=0.05, torque=1e-4, end=0.3)
    gains = ["stiffness", "damping"] + (["force_gain"] if name == "force_feedback" else [])
    assert off(panda, name, gains, cost, q0=start, disturbance=np.full(8, 0.3), **run)[0] < 1e-8


def test_it_is_that_of_differences_where_a_force_depends_on_the_state_or_torques_are_clipped(shoulder):
    goal = shoulder.robot.near_home()
    cost = QuadraticCost(goal, velocity=0.05, torque=1e-3)
    far = {"q0": goal + np.array([0.3, -0.4]), "duration": 0.4}
    assert off(shoulder, "integral_action", ["stiffness", "damping", "integral_gain"], cost, **far)[0] < 1e-8
    pushed = far | {"disturbance": lambda t, x: np.array([0.5 * t, -0.3 * x.velocity[1]])}
    assert off(shoulder, "force_feedback", ["stiffness", "damping"], cost, **pushed)[0] < 1e-8
    for name in ("energy_shaping", "force_feedback"):
        free = off(shoulder, name, ["stiffness"], cost, **far)[1]
        limit = np.quantile(np.abs(free.torque), 0.9, axis=0)
        for more in ({}, {"control_period": 4e-3}):
            worst, log = off(
                shoulder, name, ["stiffness", "damping"], cost, step=1e-6, torque_limit=limit, **far, **more
            )
            assert 0.05 < log.saturated.mean() < 0.95
            assert worst < 1e-6


def test_what_cannot_be_differentiated_is_refused(shoulder):
    cost = QuadraticCost(shoulder.robot.near_home())
    for run, reason in (
        ({"integrator": "implicit_midpoint"}, "steps of implicit_midpoint are not differentiated"),
        ({"sensors": [ForceSensor(noise=0.1)]}, "sensor"),
    ):
        with pytest.raises(CompilationError, match=reason):
            off(shoulder, "force_feedback", ["stiffness"], cost, **run)


@pytest.mark.parametrize(("name", "gains"), [("energy_shaping", None), ("force_feedback", ["stiffness", "damping"])])
def test_it_finds_the_same_optimum_with_fewer_runs(panda, name, gains):
    goal = panda.robot.near_home()
    scenarios = [
        {"q0": goal + 0.1 * np.cos(np.arange(8.0) + shift), "duration": 0.4, "dt": 2e-3, "compiled": True}
        for shift in (0.0, 1.0)
    ]
    cost, law = QuadraticCost(goal, velocity=0.05, torque=1e-4), make_controller(name, panda, goal)
    down = tune(law, cost, scenarios, gains=gains)
    simplex = tune(law, cost, scenarios, gains=gains, method="nelder-mead")
    assert (down.method, down.reason, simplex.method) == ("gradient", "", "nelder-mead")
    assert down.converged
    assert simplex.value < 0.999 * simplex.start_value
    assert down.value == pytest.approx(simplex.value, rel=1e-4)
    assert simplex.simulations == 2 * len(simplex.history)
    assert down.simulations == 2 * (len(down.history) + down.gradients + 4)  # four differences for the check
    assert down.simulations < 0.7 * simplex.simulations


def test_a_factor_for_each_joint_and_the_runs_of_a_sweep():
    sweep = Sweep(**SWEEP)
    cost = QuadraticCost([0.3, 0.5], velocity=0.02)
    found = tune(sweep.nominal.law, cost, sweep, per_joint=True, method="gradient", evaluations=60)
    assert found.gradients > 1
    by_hand = [cost(simulate(**(sweep.loop(run) | {"controller": found.law}))) for run in range(4)]
    assert found.value == pytest.approx(np.mean(by_hand), rel=1e-9)
    assert found.value < 0.97 * found.start_value


class Wrong(QuadraticCost):
    """Its slopes are not its own."""

    def slopes(self, log):
        found = super().slopes(log)
        return found._replace(position=1.001 * found.position)


def test_where_there_are_no_gradients_it_says_so_and_does_without(shoulder, monkeypatch):
    goal = shoulder.robot.near_home()
    law = make_controller("energy_shaping", shoulder, goal)
    scenario = {"q0": goal + 0.2, "duration": 0.2, "dt": 2e-3}
    cost = QuadraticCost(goal, torque=1e-3)

    def plain(log):
        return cost(log)

    found = tune(law, plain, [scenario], evaluations=10)
    assert (found.method, found.reason) == ("nelder-mead", "the objective does not say its slopes")
    assert "without gradients: the objective does not say its slopes" in str(found)
    with pytest.raises(InvalidArgumentError, match="method: is by gradients, and there are none: the objective does"):
        tune(law, plain, [scenario], method="gradient")
    for problem, more in (
        (
            r"differs from differences of the objective by \d.\de-0\d",
            {"objective": Wrong(goal, torque=1e-3), "over": [scenario]},
        ),
        ("caller's own function", {"run": lambda law, one: simulate(shoulder, law, **one), "over": [scenario]}),
        ("the largest of several", {"combine": "max", "over": [scenario, scenario | {"duration": 0.1}]}),
        ("implicit_midpoint", {"over": [scenario | {"integrator": "implicit_midpoint"}]}),
        (
            "a joint sensor",
            {"over": [scenario | {"joint_sensor": JointSensor(position_bias=1e-3), "control_period": 2e-3}]},
        ),
        ("a delay of the torque", {"over": [scenario | {"torque_delay": 2e-3, "control_period": 2e-3}]}),
    ):
        with pytest.warns(CompilationWarning, match=f"tuned without gradients: .*{problem}"):
            found = tune(law, **({"objective": cost, "evaluations": 12} | more))
        assert found.method == "nelder-mead"
        assert found.value < found.start_value
    asked = []

    def once(*arguments):
        asked.append(arguments)
        if len(asked) > 1:
            raise CompilationError("a branch")
        return gradient_along(*arguments)

    monkeypatch.setattr(gain_search, "gradient_along", once)
    with pytest.warns(CompilationWarning, match="without gradients: a branch"):
        found = tune(law, cost, [scenario], evaluations=30)
    assert found.method == "nelder-mead"
    assert len(found.history) + found.gradients <= 30
    assert found.value < found.start_value


def test_the_cost_and_its_slopes(shoulder):
    goal = shoulder.robot.near_home()
    log = simulate(shoulder, make_controller("energy_shaping", shoulder, goal), duration=0.1, dt=1e-2)
    cost = QuadraticCost(goal, position=[1.0, 2.0], velocity=0.5, torque=1e-2, end=3.0)
    error = log.position - goal
    expected = np.mean(error**2 @ [1.0, 2.0] + 0.5 * (log.velocity**2).sum(1) + 1e-2 * (log.torque**2).sum(1))
    assert cost(log) == pytest.approx(expected + 3.0 * (error[-1] ** 2).sum(), rel=1e-12)
    assert isinstance(cost, SmoothObjective)
    with pytest.raises(InvalidArgumentError, match="torque: must be >= 0"):
        QuadraticCost(goal, torque=-1.0)
    with pytest.raises(InvalidArgumentError, match="nothing would be made small"):
        QuadraticCost(goal, position=0.0)
    with pytest.raises(InvalidArgumentError, match="goal: has 1 entries"):
        QuadraticCost([0.0])(log)
    with pytest.raises(InvalidArgumentError, match=r"slopes.position: must be finite and have shape \(11, 2\)"):
        LogSlopes(position=np.zeros((3, 2))).weights(log)
