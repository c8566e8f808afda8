"""The torque filter: exact limits, exact answers, honest reports."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from phcontrol import (
    FilterStatus,
    InvalidArgumentError,
    Limits,
    Measured,
    MechanicalSystem,
    TorqueFilter,
    load_robot,
    make_controller,
)
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.registry import CONTROLLERS, laws_for
from phcontrol.safety.problem import Problem
from phcontrol.safety.quadratic_program import QuadraticProgram
from phcontrol.safety.storage_condition import StorageCondition
from tests.conftest import make_system
from tests.safety.random_cases import run
from tests.safety.true_motion import arm

PERIOD = 1e-3


@pytest.fixture
def panda_arm():
    """Seven joints, without friction."""
    return make_system("panda")


def measured_at(controller, x, rng):
    """Draw forces, and what a law with eyes sees."""
    scene = controller.eyes and controller.eyes.random_scene(x, rng)
    features = None if scene is None else scene.features(x, scene.initial_state())
    return Measured(rng.normal(size=x.system.n), rng.normal(size=x.system.n), features=features)


@pytest.mark.parametrize("seed", [11, 12])
def test_random_cases_agree_with_exact_solvers(seed):
    """A small share of what ``python -m tests.safety.random_cases --cases 1000000`` does."""
    tally = run(2500, seed)
    assert tally.hard_excess <= 1e-9
    assert tally.torque_error <= 1e-5
    assert tally.motion_error <= 1e-6
    assert tally.storage_error <= 1e-8
    assert tally.relaxed_wrongly == 0
    assert tally.statuses["FALLBACK"] == 0
    assert tally.reported_wrongly <= 1e-9
    assert tally.gap <= 1e-4
    for status in (FilterStatus.PASSED, FilterStatus.CLIPPED, FilterStatus.SOLVED, FilterStatus.STORAGE_RELAXED):
        assert tally.statuses[status.name] > 200  # each way was taken
    assert tally.relaxed > 200


def test_the_statuses_keep_their_numbers():
    """They are stored in logs."""
    names = ["PASSED", "CLIPPED", "SOLVED", "FEASIBLE", "STORAGE_RELAXED", "FALLBACK"]
    assert {status.name: int(status) for status in FilterStatus} == {name: k for k, name in enumerate(names)}


def at_rest(system, **limits):
    filter_ = TorqueFilter(system, period=PERIOD, limits=Limits(system, **limits))
    return filter_, system.at(0.5 * (system.robot.lower + system.robot.upper))


def test_a_torque_inside_all_limits_passes_unchanged(pera):
    filter_, x = at_rest(pera)
    desired = x.potential_gradient + 0.01
    result = filter_.filter(x, desired)
    assert result.status == FilterStatus.PASSED
    np.testing.assert_array_equal(result.torque, desired)
    assert result.torque is not desired
    assert (result.motion_excess, result.storage_excess) == (0.0, 0.0)


def test_without_other_limits_the_answer_is_the_clipped_torque(pera):
    filter_, x = at_rest(pera, velocity=np.inf, lower=-1e6, upper=1e6)
    desired = np.array([100.0, -100.0, 5.0, 30.0, -30.0, 1.0, 7.0])
    result = filter_.filter(x, desired)
    assert result.status == FilterStatus.CLIPPED
    np.testing.assert_array_equal(result.torque, np.clip(desired, -pera.robot.effort_limit, pera.robot.effort_limit))


def test_the_torque_rate_is_kept_exactly_and_starts_anywhere(pera):
    filter_, x = at_rest(pera, torque_rate=50.0, velocity=np.inf, lower=-1e6, upper=1e6)
    previous = x.potential_gradient
    result = filter_.filter(x, previous + 10.0, previous=previous)
    np.testing.assert_allclose(result.torque, np.minimum(previous + 0.05, pera.robot.effort_limit), rtol=1e-12)
    beyond = filter_.filter(x, np.zeros(7), previous=pera.robot.effort_limit * 3.0)
    assert (np.abs(beyond.torque) <= pera.robot.effort_limit).all()


def test_the_predicted_velocity_comes_true(pera):
    """One period with the filtered torque, plant integrated exactly: the speed ends at its limit."""
    filter_, x = at_rest(pera, velocity=0.005, effort=60.0)
    result = filter_.filter(x, x.potential_gradient + 20.0)
    assert result.status == FilterStatus.SOLVED
    y = np.concatenate([x.position, x.velocity])
    for _ in range(100):
        state = pera.at(y[:7], y[7:])
        y = y + PERIOD / 100 * np.concatenate([state.velocity, state.acceleration(result.torque)])
    assert np.abs(y[7:]).max() == pytest.approx(0.005, rel=0.05)
    assert (np.abs(y[7:]) <= 0.005 * 1.05).all()


def held(system, controller, x, state, rate, torque, period):
    """Return the mean rate of H_d over a period with a torque held, along the plant's true motion [W]."""
    y, steps = np.concatenate([x.position, x.velocity]), 20
    n, dt = system.n, period / steps

    def flow(y):
        return np.concatenate([y[n:], system.at(y[:n], y[n:]).acceleration(torque)])

    for _ in range(steps):  # Runge-Kutta
        k1 = flow(y)
        k2 = flow(y + 0.5 * dt * k1)
        k3 = flow(y + 0.5 * dt * k2)
        y = y + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + flow(y + dt * k3))
    after = controller.storage(period, system.at(y[:n], y[n:]), state + period * rate)
    return (after - controller.storage(0.0, x, state)) / period


ALL_OF_IT = ("energy_shaping", "classical_impedance", "classical_impedance_compensated", "tracking",
             "tracking_measured", "force_control")  # fmt: skip


@pytest.mark.parametrize("law", [law for law, entry in CONTROLLERS.items() if "features" not in entry.needs])
def test_the_mean_rate_of_the_storage_function_is_predicted_to_second_order(law, panda_arm):
    """Against the true motion, with a torque far from the law's: ŷᵀΔ alone would miss all of what is compared here.

    Where nothing but the torques moves ŷ, all of it is caught; where q or the law's own state do too, most of it.
    """
    controller, rng, n = make_controller(law, panda_arm), np.random.default_rng(3), panda_arm.n
    missed, second_order = [], []
    for _ in range(6):
        x = panda_arm.at(panda_arm.robot.random_position(rng), 0.3 * rng.normal(size=n))
        state = 0.1 * controller.random_state(rng)
        measured = Measured(external_force=np.zeros(n), total_force=x.total_force())
        desired, rate = controller.evaluate(0.0, x, state, measured)
        port = controller.passive_port(0.0, x, state, measured)
        change = 0.5 * panda_arm.robot.effort_limit * rng.normal(size=n)
        truth = held(panda_arm, controller, x, state, rate, desired + change, PERIOD)
        truth -= held(panda_arm, controller, x, state, rate, desired, PERIOD)
        inertia = x.mass_matrix + PERIOD * x.damping_matrix
        own, kick = (
            PERIOD * np.linalg.solve(inertia, x.mass_matrix @ x.acceleration(u)) for u in (desired, desired + change)
        )
        condition = StorageCondition(port, None)
        predicted = condition.power(change, kick) - condition.power(np.zeros(n), own)
        missed.append(abs(truth - predicted))
        second_order.append(abs(truth - port.output @ change))
    assert np.median(second_order) > 1.0  # [W]
    assert np.median(missed) <= (0.01 if law in ALL_OF_IT else 0.5) * np.median(second_order)


@pytest.mark.parametrize("name", ["z1", "panda"])
def test_with_dry_friction_too_the_storage_function_grows_by_no_more_than_predicted(name):
    """Beyond what the law's own torque does, with torques far from it, from rest and in motion.

    Predicted with the friction of the present velocity it grew by 7 W more than that, of 60.
    """
    system = arm(name, coulomb=2.0)
    controller, rng, n = make_controller("energy_shaping", system), np.random.default_rng(3), system.n
    filter_, state = TorqueFilter(system, period=PERIOD), np.zeros(0)
    missed, sizes = [], []
    for _ in range(30):
        x = system.at(system.robot.random_position(rng), 10.0 ** -rng.integers(0, 4) * rng.normal(size=n))
        desired, rate = controller.evaluate(0.0, x, state)
        condition = StorageCondition(controller.passive_port(0.0, x, state), None)
        change = rng.choice([0.05, 0.3]) * system.robot.effort_limit * rng.normal(size=n)
        own, grown = (held(system, controller, x, state, rate, u, PERIOD) for u in (desired, desired + change))
        motion = filter_._motion(x, None)
        kicks = [motion.next_velocity(u) - x.velocity for u in (desired, desired + change)]
        predicted = condition.power(change, kicks[1]) - condition.allowed(kicks[0])
        missed.append(max(0.0, grown - max(0.0, own)) - max(0.0, predicted))
        sizes.append(abs(grown))
    assert max(sizes) > 50.0  # [W]
    assert max(missed) <= 1e-3 * max(sizes)


def test_over_a_period_the_storage_function_does_not_grow(panda_arm):
    """H_d along the true motion, where the condition is said to hold; under the clipped torque it would grow."""
    controller = make_controller("energy_shaping", panda_arm, stiffness=50.0, damping=1.0)
    filter_ = TorqueFilter(panda_arm, period=PERIOD, limits=Limits(panda_arm, effort=40.0, braking_acceleration=5.0))
    rng, seen, would_grow = np.random.default_rng(4), 0, 0
    for _ in range(600):
        x = panda_arm.at(panda_arm.robot.random_position(rng), rng.normal(size=7))
        desired, rate = controller.evaluate(0.0, x, np.zeros(0))
        port = controller.passive_port(0.0, x, np.zeros(0))
        result = filter_.filter(x, desired, port=port)
        if result.status not in (FilterStatus.SOLVED, FilterStatus.CLIPPED):
            continue
        seen += 1
        grown = held(panda_arm, controller, x, np.zeros(0), rate, result.torque, PERIOD)
        own = held(panda_arm, controller, x, np.zeros(0), rate, desired, PERIOD)
        bend = 0.5 * PERIOD * (result.torque - desired) @ np.linalg.solve(x.mass_matrix, result.torque - desired)
        assert grown <= max(0.0, own) + 0.02 * bend
        clipped = np.clip(desired, -40.0, 40.0)
        would_grow += held(panda_arm, controller, x, np.zeros(0), rate, clipped, PERIOD) > max(0.0, own) + 0.1 * bend
    assert seen >= 50
    assert would_grow >= 20


@pytest.mark.parametrize("law", CONTROLLERS)
@pytest.mark.parametrize("arm", ["pera", "pera_gripper", "geared"])
def test_the_resistance_is_half_the_slope_of_the_losses(law, arm):
    """By differences of ∇H_dᵀR_d∇H_d along q̇, R_d held: exact, for it is quadratic."""
    for controller, x, state, measured in drawn(law, arm, seed=9, count=1):
        port = controller.passive_port(0.3, x, state, measured)
        R = controller.target(0.3, x, state, measured).dissipation

        def losses(velocity, controller=controller, x=x, state=state, measured=measured, R=R):
            gradient = controller.target(0.3, x.system.at(x.position, velocity), state, measured).gradient
            return gradient @ R @ gradient

        slope = [0.5 * (losses(x.velocity + unit) - losses(x.velocity - unit)) for unit in np.eye(x.system.n)]
        scale = 1.0 + np.abs(port.resistance).max()
        np.testing.assert_allclose(port.resistance, 0.5 * np.array(slope), atol=1e-9 * scale)


def drawn(law, arm, seed, count):
    """Draw states of a law and an arm, if the law can be made for it."""
    system = geared() if arm == "geared" else make_system(arm)
    if law not in laws_for(system):
        return
    rng, controller = np.random.default_rng(seed), make_controller(law, system)
    for _ in range(count):
        x = system.at(system.robot.random_position(rng), rng.normal(size=system.n))
        yield controller, x, controller.random_state(rng), measured_at(controller, x, rng)


def geared():
    """Return an arm whose motors turn several joints each."""
    matrix = np.eye(3) + 0.2 * np.random.default_rng(2).normal(size=(3, 3))
    return MechanicalSystem(load_robot("pera_shoulder_elbow"), input_matrix=matrix)


@pytest.mark.parametrize("law", CONTROLLERS)
@pytest.mark.parametrize("arm", ["pera", "pera_gripper", "geared"])
def test_the_passive_port_is_what_target_and_storage_say(law, arm):
    """ŷ = ∂Ḣ_d/∂u by moving the torque, the dissipated power from the target: for every law."""
    for controller, x, state, measured in drawn(law, arm, seed=8, count=5):
        system, n = x.system, x.system.n
        port = controller.passive_port(0.3, x, state, measured)
        target = controller.target(0.3, x, state, measured)
        power = target.gradient @ target.dissipation @ target.gradient
        assert port.dissipated_power == pytest.approx(power, rel=1e-9, abs=1e-9)
        step = 1e-4
        output = np.empty(n)
        for joint, unit in enumerate(np.eye(n)):
            kick = np.linalg.solve(x.mass_matrix, system.at(x.position).input_matrix @ unit) * step
            ahead, behind = system.at(x.position, x.velocity + kick), system.at(x.position, x.velocity - kick)
            rise = controller.storage(0.3, ahead, state, measured) - controller.storage(0.3, behind, state, measured)
            output[joint] = rise / (2.0 * step)
        scale = 1.0 + np.abs(port.output).max()
        np.testing.assert_allclose(port.output, output, atol=1e-7 * scale)


@pytest.mark.parametrize("law", CONTROLLERS)
def test_the_calmest_state_makes_the_storage_smallest(law, pera):
    controller, rng = make_controller(law, pera), np.random.default_rng(5)
    if not controller.state_size:
        return
    free = [k for k, name in enumerate(n for n, size in controller.state_parts.items() for _ in range(size)) if name in
            ("force", "rest_length")]  # fmt: skip
    for _ in range(5):
        x = pera.at(pera.robot.random_position(rng), rng.normal(size=7))
        state = controller.random_state(rng)
        calm = controller.calmest_state(0.0, x, state)
        lowest = controller.storage(0.0, x, calm)
        held = [k for k in range(state.size) if k not in free]
        np.testing.assert_array_equal(calm[held], state[held])
        for k in free:
            for step in (1e-3, -1e-3):
                moved = calm.copy()
                moved[k] += step
                assert controller.storage(0.0, x, moved) > lowest


def test_general_and_closed_form_ports_agree(pera):
    from phcontrol.controllers.controller import Controller

    rng = np.random.default_rng(6)
    for law in CONTROLLERS:
        controller = make_controller(law, pera)
        x = pera.at(pera.robot.random_position(rng), rng.normal(size=7))
        state, measured = controller.random_state(rng), measured_at(controller, x, rng)
        special = controller.passive_port(0.0, x, state, measured)
        general = Controller.passive_port(controller, 0.0, x, state, measured)
        np.testing.assert_allclose(special.output, general.output, atol=1e-8 * (1.0 + np.abs(general.output).max()))
        assert special.dissipated_power == pytest.approx(general.dissipated_power, rel=1e-9)
        scale = 1.0 + np.abs(general.resistance).max()
        np.testing.assert_allclose(special.resistance, general.resistance, atol=1e-9 * scale)


@settings(max_examples=60)
@given(
    desired=arrays(float, 2, elements=st.floats(-1e300, 1e300)),
    velocity=arrays(float, 2, elements=st.floats(-1e3, 1e3)),
    position=arrays(float, 2, elements=st.floats(-10.0, 10.0)),
    output=arrays(float, 2, elements=st.floats(-1e12, 1e12)),
    power=st.floats(0.0, 1e12),
    resistance=arrays(float, 2, elements=st.floats(-1e12, 1e12)),
)
def test_whatever_comes_in_a_torque_inside_the_limits_comes_out(desired, velocity, position, output, power, resistance):
    system = make_system("pera_shoulder")
    filter_ = EXTREME
    with np.errstate(all="ignore"):
        port = PassivePort(output, power, resistance)
        result = filter_.filter(system.at(position, velocity), desired, previous=np.zeros(2), port=port)
    assert np.isfinite(result.torque).all()
    assert (np.abs(result.torque) <= system.robot.effort_limit).all()
    assert (np.abs(result.torque) <= 5.0 + 1e-12).all()  # 5000 N·m/s for 1 ms from 0


EXTREME = TorqueFilter(
    make_system("pera_shoulder"), period=PERIOD, limits=Limits(make_system("pera_shoulder"), torque_rate=5000.0)
)


@pytest.mark.parametrize("metric", ["inertia", np.diag([1.0, 5.0])])
def test_other_metrics_agree_with_a_general_solver(shoulder, metric):
    """Nearest in another metric: no point of a fine grid inside the limits is nearer."""
    shoulder = MechanicalSystem(shoulder.robot, friction=None)
    limits = Limits(shoulder, velocity=0.02)
    filter_ = TorqueFilter(shoulder, period=PERIOD, limits=limits, metric=metric)
    x = shoulder.at([-0.5, 0.4], [0.015, -0.01])
    W = np.linalg.inv(x.mass_matrix) if isinstance(metric, str) else metric
    desired = np.array([30.0, -60.0])
    result = filter_.filter(x, desired)
    assert result.status == FilterStatus.SOLVED

    def distance(u):
        return float((u - desired) @ W @ (u - desired))

    inside = 0
    effect = PERIOD * np.linalg.inv(x.mass_matrix)
    drift = x.velocity - effect @ (x.coriolis_matrix @ x.velocity + x.potential_gradient)
    for u in result.torque + np.random.default_rng(0).normal(size=(4000, 2)) * 0.5:
        ok = (np.abs(u) <= limits.effort).all() and (np.abs(drift + effect @ u) <= 0.02).all()
        if ok:
            inside += 1
            assert distance(u) >= distance(result.torque) - 1e-6
    assert inside > 100


def test_a_joint_without_an_effort_limit_is_not_clipped(shoulder):
    limits = Limits(shoulder, effort=[np.inf, 40.0], velocity=np.inf, lower=-1e6, upper=1e6, braking_acceleration=1.0)
    filter_ = TorqueFilter(shoulder, period=PERIOD, limits=limits)
    result = filter_.filter(shoulder.at([0.1, 0.1]), np.array([1e4, 100.0]))
    np.testing.assert_allclose(result.torque, [1e4, 40.0])
    slow = TorqueFilter(
        shoulder, period=PERIOD, limits=Limits(shoulder, effort=[np.inf, 40.0], velocity=0.1, braking_acceleration=1.0)
    )
    result = slow.filter(shoulder.at([-0.5, 0.1]), np.array([1e4, 0.0]))
    assert result.status == FilterStatus.SOLVED
    assert 10.0 < result.torque[0] < 1e3


def test_a_solver_that_fails_is_replaced_and_reported(pera, monkeypatch):
    filter_, x = at_rest(pera, velocity=0.01)
    monkeypatch.setattr(QuadraticProgram, "solve", lambda self, problem, feasible=None: None)
    moving = pera.at(x.position, np.full(7, 0.02))
    result = filter_.filter(moving, np.full(7, 5.0), port=PassivePort(np.ones(7), 1.0, np.zeros(7)))
    assert result.status == FilterStatus.FALLBACK
    assert filter_.counts[FilterStatus.FALLBACK] == 1
    assert (np.abs(result.torque) <= pera.robot.effort_limit).all()
    acceleration = moving.acceleration(result.torque)
    assert (acceleration < 0.0).all()  # it brakes
    filter_.reset()
    assert filter_.counts[FilterStatus.FALLBACK] == 0


def test_the_check_of_optimality_refuses_what_is_not_optimal():
    """The residuals vanish at the optimum, found by hand, and at no point beside it."""
    problem = Problem(
        None, np.array([-2.0, 0.0]), np.array([[1.0, 0.0]]), np.array([-1.0]), np.array([0.5]), -np.ones(2), np.ones(2)
    )
    best, multiplier = np.array([0.5, 0.0]), np.array([1.5])  # z₁ − 2 + λ = 0 at z₁ = ½
    assert problem.accepts(best, multiplier)
    for z in ([0.5, 1e-8], [0.5 - 1e-8, 0.0], [0.5 + 1e-8, 0.0], [np.nan, 0.0]):
        assert not problem.accepts(np.array(z), multiplier)
    for wrong in (1.5 + 1e-8, 0.0, -1.5, np.nan):
        assert not problem.accepts(best, np.array([wrong]))
    np.testing.assert_allclose(QuadraticProgram(2, 1).solve(problem), best, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"period": 0.0}, "period: must be > 0"),
        ({"period": PERIOD, "limits": 3}, "limits: must be Limits"),
        ({"period": PERIOD, "metric": "torque"}, "metric: must be 'effort'"),
        ({"period": PERIOD, "metric": -np.eye(7)}, "metric: must be positive definite"),
        ({"period": PERIOD, "storage": 1}, "storage: must be True or False"),
    ],
)
def test_bad_arguments_are_refused(pera, arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        TorqueFilter(pera, **arguments)


def test_a_filter_needs_a_system():
    with pytest.raises(InvalidArgumentError, match="system: must be a MechanicalSystem"):
        TorqueFilter("pera", period=PERIOD)
