"""Disturbances against the functions they stand for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from phcontrol import InvalidArgumentError, UnknownNameError
from phcontrol.environments.disturbances import Pulse, Sampled, Sine, Step, Wrench, wrenches_of
from tests.conftest import make_system

FORCE = np.array([3.0, -3.0])
X = make_system("pera_shoulder").at([0.3, 0.2])


@given(st.floats(-10, 10), st.floats(-5, 5), st.floats(0.1, 5))
@example(1.0, 1.0, 0.5)
@example(1.5, 1.0, 0.5)
def test_step_and_pulse(t, start, duration):
    np.testing.assert_array_equal(Step(FORCE, start)(t, X), FORCE * (t >= start))
    np.testing.assert_array_equal(Pulse(FORCE, start, duration)(t, X), FORCE * (start <= t < start + duration))


@given(st.floats(0, 10), st.floats(0.01, 10), st.floats(-3, 3), st.floats(-5, 5))
def test_sums_and_multiples(t, frequency, phase, factor):
    both = factor * (Sine(FORCE, frequency, phase) + Step([1.0, 0.0], 2.0)) + Pulse([0.0, 1.0], 1.0, 3.0) * 2.0
    expected = factor * (FORCE * np.sin(2 * np.pi * frequency * t + phase) + np.array([t >= 2.0, 0.0]))
    expected = expected + np.array([0.0, 2.0 * (1.0 <= t < 4.0)])
    np.testing.assert_allclose(both(t, X), expected, atol=1e-9)


def test_sampled_forces_follow_the_array():
    times, forces = np.array([0.0, 1.0, 3.0]), np.array([[0.0, 1.0], [2.0, 1.0], [2.0, -3.0]])
    linear, held = Sampled(times, forces), Sampled(times, forces, interpolation="hold")
    for t in np.linspace(0.0, 3.0, 31):
        np.testing.assert_allclose(linear(t, X), [np.interp(t, times, column) for column in forces.T], atol=1e-12)
    np.testing.assert_array_equal(held(2.9, X), [2.0, 1.0])
    np.testing.assert_array_equal(held(3.0, X), [2.0, -3.0])
    np.testing.assert_array_equal(linear(3.1, X), [0.0, 0.0])
    np.testing.assert_array_equal(linear(-0.1, X), [0.0, 0.0])


@given(st.floats(-0.5, 3.5))
@example(0.0)
@example(1.0)
@example(2.5)
@example(3.0)
def test_held_forces_are_those_of_the_last_sample(t):
    times, forces = np.array([0.0, 1.0, 2.5, 3.0]), np.array([[1.0, -1.0], [2.0, -2.0], [3.0, -3.0], [4.0, -4.0]])
    passed = [force for time, force in zip(times, forces, strict=True) if time <= t]
    expected = passed[-1] if passed and t <= 3.0 else [0.0, 0.0]
    np.testing.assert_array_equal(Sampled(times, forces, "hold")(t, X), expected)
    linear = [np.interp(t, times, column, left=0.0, right=0.0) for column in forces.T]
    np.testing.assert_allclose(Sampled(times, forces)(t, X), linear, atol=1e-12)


def test_by_default_steps_are_there_from_the_start_and_sines_have_no_phase():
    np.testing.assert_array_equal(Step(FORCE)(0.0, X), FORCE)
    np.testing.assert_array_equal(Step(FORCE)(-1e-9, X), [0.0, 0.0])
    np.testing.assert_array_equal(Sine(FORCE, 2.0)(0.0, X), [0.0, 0.0])


def test_only_disturbances_are_added():
    for other in (1.0, FORCE, None):
        with pytest.raises(TypeError):
            _ = Step(FORCE) + other


def test_the_wrenches_in_a_sum_and_their_forces_in_the_world():
    pull, turn = Wrench("tool", [1.0, 2.0, 3.0, 0.0, 0.0, 0.0], reference="local"), Wrench("tool", np.arange(6.0))
    assert wrenches_of(pull + (Step(FORCE) + turn)) == (pull, turn)
    assert wrenches_of(Step(FORCE)) == wrenches_of(None) == ()
    rotation = X.placement("tool").rotation
    assert np.abs(rotation - np.eye(3)).max() > 0.1
    np.testing.assert_allclose(pull.world_force(0.0, X), rotation @ [1.0, 2.0, 3.0], atol=1e-12)
    np.testing.assert_array_equal(turn.world_force(0.0, X), [0.0, 1.0, 2.0])


def test_a_wrench_in_the_world_acts_at_the_worlds_origin():
    force, moment = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.2, -0.1])
    origin = X.placement("tool").translation
    at_tool = Wrench("tool", np.r_[force, moment - np.cross(origin, force)])
    np.testing.assert_allclose(Wrench("tool", np.r_[force, moment], "world")(0.0, X), at_tool(0.0, X), atol=1e-12)


def test_a_wrench_does_the_same_work_as_its_joint_forces(rng):
    """Virtual power: Fᵀ(twist) = f_eᵀq̇, with the twist by finite differences of the frame's pose."""
    system = make_system("pera")
    q, v = system.robot.random_position(rng), rng.normal(size=7)
    force = rng.normal(size=3)
    x, h = system.at(q, v), 1e-6
    ahead, behind = system.at(q + h * v, v), system.at(q - h * v, v)
    velocity = (ahead.placement("tool").translation - behind.placement("tool").translation) / (2.0 * h)
    joint_forces = Wrench("tool", np.r_[force, 0, 0, 0])(0.0, x)
    assert joint_forces @ v == pytest.approx(force @ velocity, rel=1e-6)
    local = Wrench("tool", np.r_[x.placement("tool").rotation.T @ force, 0, 0, 0], reference="local")
    np.testing.assert_allclose(local(0.0, x), joint_forces, atol=1e-12)
    moving = Wrench("tool", lambda t: np.r_[t * force, 0, 0, 0])
    np.testing.assert_allclose(moving(2.0, x), 2.0 * joint_forces)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Step([np.nan, 0.0]), "force: must be finite"),
        (lambda: Step(3.0), "force: must be a vector"),
        (lambda: Pulse(FORCE, 0.0, 0.0), "duration: must be > 0"),
        (lambda: Sine(FORCE, -1.0), "frequency: must be > 0"),
        (lambda: Sampled([0.0, 0.0], [[1.0], [2.0]]), "times: must be an increasing vector"),
        (lambda: Sampled([1.0], [[1.0]]), "times: must be an increasing vector of at least two"),
        (lambda: Sampled([[0.0, 1.0]], [[1.0], [2.0]]), "times: must be an increasing vector"),
        (lambda: Sampled([1.0, 0.0], [[1.0], [2.0]]), "times: must be an increasing vector"),
        (lambda: Sampled([0.0, 1.0], [[1.0], [2.0], [3.0]]), "forces: must have one row for each of the 2 times"),
        (lambda: Sampled([0.0, 1.0], [1.0, 2.0]), "forces: must have one row for each of the 2 times"),
        (lambda: Wrench("tool", [1.0, 2.0, 3.0]), r"wrench: must have shape \(6,\)"),
        (lambda: Wrench("tool", lambda t: [1.0])(0.0, X), r"wrench: must have shape \(6,\)"),
        (lambda: Step(FORCE) * np.inf, "factor: must be finite"),
    ],
)
def test_bad_disturbances_are_refused(make, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        make()


def test_unknown_frames_are_refused():
    with pytest.raises(UnknownNameError, match="unknown frame 'hand'"):
        Wrench("hand", np.zeros(6))(0.0, X)
    with pytest.raises(UnknownNameError, match="unknown frame of reference 'base'"):
        Wrench("tool", np.zeros(6), reference="base")
