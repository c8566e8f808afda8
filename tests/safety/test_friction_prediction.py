"""Dry friction in the torque filter: what it may do to the next velocity, judged by the true motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from phcontrol import (
    FilterStatus,
    InvalidArgumentError,
    Limits,
    MechanicalSystem,
    StribeckFriction,
    TorqueFilter,
    load_robot,
)
from phcontrol.safety.friction_prediction import FrictionPrediction
from tests.safety.friction_loops import limits_of, loop
from tests.safety.true_motion import arm, by_forward_dynamics, run

PERIOD = 1e-3
FINE = 1e-3  # of the bounds: what inertia and load do within a period, see true_motion.py
TURNING = 1e-2  # likewise, where the motors may not turn their torque at once while another joint's friction turns


def middle_of(system):
    """Return the middle between the position limits."""
    return system.at(0.5 * (system.robot.lower + system.robot.upper))


def held(system, x, torque):
    """Return the velocity after a period, integrated in steps of 1 µs."""
    q, v = x.position, x.velocity
    for _ in range(1000):
        v = v + 1e-6 * system.at(q, v).acceleration(torque)
        q = q + 1e-6 * v
    return v


def test_friction_that_saturates_does_not_hold_a_joint():
    """From rest, 30 N·m on every joint of the Z1: the prediction was 0.5 rad/s and the truth 1.88."""
    system = arm("z1")
    limits = Limits(system, velocity=0.5)
    x = middle_of(system)
    result = TorqueFilter(system, period=PERIOD, limits=limits).filter(x, np.full(7, 30.0))
    assert result.status == FilterStatus.SOLVED
    assert result.motion_excess <= 1e-3
    true = np.abs(held(system, x, result.torque)).max()
    assert true <= 0.5 + result.motion_excess
    assert true >= 0.4  # and no more is given away than what friction may do


@pytest.mark.parametrize("seed", [1, 2])
def test_the_true_motion_stays_inside_the_bounds(seed):
    """A small share of what ``python -m tests.safety.true_motion --cases 1000000`` does."""
    tally = run(1500, seed)
    assert tally.relative <= 0.03
    assert tally.relative_frozen <= 0.02  # what is left of that when inertia and load cannot change
    assert tally.above[0.1] == 0
    assert tally.statuses["FALLBACK"] == 0
    for status in ("PASSED", "CLIPPED", "SOLVED"):
        assert tally.statuses[status] > 50
    assert 0.1 < tally.excessive / tally.cases < 0.9


def test_the_judge_agrees_with_forward_dynamics():
    """Parabolas of inertia and load in steps of 10 µs against the articulated-body algorithm in steps of 1 µs."""
    worst = []

    def report(tally, system, batch, over, true, frozen, friction, period):
        case = int(np.argmax(np.abs(true - batch.velocity).max(axis=1)))
        worst.append(np.abs(by_forward_dynamics(system, batch, case, period, friction) - true[case]).max())

    run(750, 6, report=report)
    assert max(worst) <= 1e-3  # of several rad/s


@pytest.mark.parametrize("torque_rate", [None, 3000.0, 1000.0, 300.0])
@pytest.mark.parametrize("name", ["z1", "xarm7", "tiago", "talos_arm", "panda"])
def test_a_closed_loop_keeps_its_velocity_limits(name, torque_rate):
    """Energy shaping to a goal outside the limits, the plant in steps of 0.1 ms: it came to 3 times its limits."""
    system = arm(name, coulomb=2.0)
    # at full speed the load of the tiago changes by 350 N·m/s
    limits = limits_of(system, torque_rate, velocity=0.8 * system.robot.velocity_limit)
    log = loop(system, limits, duration=0.25)
    fastest = (np.abs(log.velocity) / limits.velocity).max()
    assert fastest <= 1.0 + (FINE if torque_rate is None else TURNING)
    assert fastest >= 0.9
    assert np.maximum(log.position - limits.upper, limits.lower - log.position).max() <= 1e-4
    assert (log.filter_activity["status"] != FilterStatus.FALLBACK).all()


@given(
    damping=st.floats(1e-4, 1e3), torque=st.floats(-6.0, 6.0), speed=st.floats(-1.0, 1.0), period=st.floats(1e-4, 1e-2)
)
def test_viscous_friction_of_a_single_joint_is_predicted_exactly(damping, torque, speed, period):
    """However stiff: against v⁺ = e^(−x)v + (1 − e^(−x))f/d, x = hd/M."""
    system = MechanicalSystem(load_robot("pera_gripper"), friction=StribeckFriction(viscous=damping))
    x = system.at(system.robot.home, np.array([speed]))
    filter_ = TorqueFilter(system, period=period, limits=Limits(system, effort=1e4, velocity=1e3))
    predicted = filter_._motion(x, None).next_velocity(np.array([torque]))
    force, decay = torque - x.potential_gradient, np.exp(-period * damping / x.mass_matrix[0, 0])
    exact = decay * speed + (1.0 - decay) * force / damping
    np.testing.assert_allclose(predicted, exact, rtol=1e-6, atol=1e-9)


parts = st.floats(0.0, 5.0)


@given(
    coulomb=parts, more=parts, stribeck=st.floats(0.01, 1.0), smoothing=st.floats(1e-6, 0.1),
    ends=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
)  # fmt: skip
def test_the_range_of_the_dry_torque_holds_everywhere_inside(coulomb, more, stribeck, smoothing, ends):
    friction = StribeckFriction(
        viscous=0.7, coulomb=coulomb, static=coulomb + more, stribeck_velocity=stribeck, smoothing=smoothing
    )
    low, high = min(ends), max(ends)
    speeds = np.linspace(low, high, 301)
    torques = (friction.coefficients(speeds) - 0.7) * speeds
    least, most = friction.dry_torque_range(np.array([low]), np.array([high]))
    assert least[0] <= torques.min() + 1e-9
    assert most[0] >= torques.max() - 1e-9
    if more == 0.0:  # it rises with the velocity
        np.testing.assert_allclose([least[0], most[0]], torques[[0, -1]], atol=1e-9)


class Undeclared:
    """Friction that says no more than its coefficients."""

    def __init__(self, friction):
        self.coefficients = friction.coefficients


@pytest.mark.parametrize("torque", [30.0, -30.0])
def test_a_friction_that_declares_nothing_is_sampled(torque):
    declared = arm("z1")
    system = MechanicalSystem(declared.robot, friction=Undeclared(declared.friction))
    limits = Limits(system, velocity=0.5)
    filter_, x = TorqueFilter(system, period=PERIOD, limits=limits), middle_of(system)
    result = filter_.filter(x, np.full(7, torque))
    true = np.abs(held(system, x, result.torque)).max()
    assert 0.3 <= true <= 0.5 + result.motion_excess
    prediction = FrictionPrediction(system, PERIOD, limits.velocity)
    speeds = np.linspace(-0.99, 0.99, 501)[:, None] * np.ones(7)
    least, most = prediction._model.dry_torque_range(speeds, speeds)
    dry = (declared.friction.coefficients(speeds) - prediction.viscous) * speeds
    assert (least <= dry + 1e-12).all()
    assert (dry <= most + 1e-12).all()
    assert (most - least <= 2.1 * np.array(declared.friction.coulomb) + 1e-9).all()


def test_a_sampled_friction_pushes_only_against_the_motions_there_are(pera):
    """3 N·m of Coulomb friction: either way where a joint may turn back, one way where it cannot."""
    system = MechanicalSystem(pera.robot, friction=Undeclared(StribeckFriction(coulomb=3.0, smoothing=1e-9)))
    model = FrictionPrediction(system, PERIOD, pera.robot.velocity_limit)._model
    for low, high, expected in ((-0.2, 0.2, [-3.0, 3.0]), (0.1, 0.2, [0.0, 3.0]), (-0.2, -0.1, [-3.0, 0.0])):
        found = model.dry_torque_range(np.full(7, low), np.full(7, high))
        np.testing.assert_allclose(found, np.outer(expected, np.ones(7)), rtol=3e-3)


def test_viscous_friction_costs_no_room(pera):
    for friction in (None, StribeckFriction(viscous=2.0), Undeclared(StribeckFriction(viscous=2.0))):
        system = MechanicalSystem(pera.robot, friction=friction)
        filter_ = TorqueFilter(system, period=PERIOD)
        assert filter_._dry is None
    assert TorqueFilter(pera, period=PERIOD)._dry is not None


@pytest.mark.parametrize("value", [np.nan, -1.0, np.inf])
def test_a_friction_without_sense_is_refused(pera, value):
    class Senseless:
        def coefficients(self, velocity):
            return np.where(velocity > 0.5, value, 1.0)

    system = MechanicalSystem(pera.robot, friction=Senseless())
    with pytest.raises(InvalidArgumentError, match=r"friction: must have finite coefficients >= 0"):
        TorqueFilter(system, period=PERIOD)


def test_where_bounds_contradict_the_excess_is_told():
    """One joint between two near position limits: the other's dry friction may throw it further than there is room."""
    system = arm("panda", coulomb=2.0)
    x, robot = middle_of(system), system.robot
    fixed = np.arange(7) == 4
    limits = Limits(
        system,
        lower=np.where(fixed, x.position - 1e-6, robot.lower),
        upper=np.where(fixed, x.position + 1e-6, robot.upper),
        braking_acceleration=5.0,
    )
    filter_ = TorqueFilter(system, period=PERIOD, limits=limits)
    bounds = filter_._bounds(x, filter_._motion(x, None))
    assert (bounds.predicted[0] > bounds.predicted[1]).any()
    assert (bounds.aimed[0] <= bounds.aimed[1]).all()
    result = filter_.filter(x, x.potential_gradient + 12.0)
    low, high = limits.velocity_bounds(x.position, x.velocity, PERIOD)
    true = held(system, x, result.torque)
    assert result.motion_excess > 1e-3
    assert (true <= high + result.motion_excess + 1e-4).all()
    assert (true >= low - result.motion_excess - 1e-4).all()


def test_a_joint_without_a_velocity_limit_may_have_dry_friction(pera):
    limits = Limits(pera, velocity=np.inf, lower=-np.inf, upper=np.inf, braking_acceleration=1.0)
    result = TorqueFilter(pera, period=PERIOD, limits=limits).filter(middle_of(pera), np.full(7, 5.0))
    assert (result.status, result.motion_excess) == (FilterStatus.PASSED, 0.0)


def test_a_filter_that_knows_the_least_friction_keeps_the_limits_with_more():
    """Friction 30 % less and 30 % more than the law's model, the filter's being the least of both."""
    system = arm("xarm7")
    for error in (-0.3, 0.3):
        for torque_rate in (None, 1000.0):
            log = loop(system, limits_of(system, torque_rate), seed=1, error=error, model=0.7, duration=0.3)
            assert (np.abs(log.velocity) / system.robot.velocity_limit).max() <= 1.03


@pytest.mark.parametrize(("name", "most"), [("xarm7", 0.055), ("z1", 0.002), ("tiago", 0.002)])
def test_what_the_inertia_couples_into_viscous_friction_is_small(name, most):
    """The next velocity under viscous friction alone against the matrix exponential, at 2 ms."""
    system, h = arm(name), 2e-3
    n, generator = system.n, np.random.default_rng(1)
    prediction = FrictionPrediction(system, h, system.robot.velocity_limit)
    worst = 0.0
    for _ in range(200):
        x = system.at(system.robot.random_position(generator))
        force = generator.normal(size=n) * system.robot.effort_limit.clip(max=100.0)
        flow = np.zeros((2 * n, 2 * n))
        flow[:n, :n] = -np.linalg.solve(x.mass_matrix, np.diag(prediction.viscous))
        flow[:n, n:] = np.eye(n)
        exact = expm(h * flow)[:n, n:] @ np.linalg.solve(x.mass_matrix, force)
        predicted = h * np.linalg.solve(x.mass_matrix + np.diag(prediction.implicit), force)
        worst = max(worst, np.abs(predicted - exact).max() / np.abs(exact).max())
    assert 1e-5 < worst < most
