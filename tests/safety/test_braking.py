"""How hard and how soon all joints can brake, against Pinocchio's inverse dynamics and closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import InvalidArgumentError
from phcontrol.safety import _numpy, kernels
from phcontrol.safety.braking import _load_rate, _samples, _within, braking_acceleration_within
from tests.conftest import make_system


@pytest.mark.parametrize("arm", ["pera", "ur5"])
def test_the_rate_of_the_load_is_that_of_inverse_dynamics(arm):
    """d/dt of M(q)a + C q̇ + ∂V/∂q along a motion with constant a, by RNEA and differences of fourth order."""
    system, generator = make_system(arm), np.random.default_rng(3)
    model, data = system.model, system.model.createData()
    for _ in range(5):
        q = system.robot.random_position(generator)
        v, a = generator.uniform(-2.0, 2.0, (2, system.n))

        def load(t, q=q, v=v, a=a):
            torque = pin.rnea(model, data, q + t * v + 0.5 * t * t * a, v + t * a, a)
            return torque.copy()

        h = 1e-3
        rate = (8.0 * (load(h) - load(-h)) - (load(2.0 * h) - load(-2.0 * h))) / (12.0 * h)
        np.testing.assert_allclose(_load_rate(system, q, v, a), rate, rtol=1e-6, atol=1e-6 * np.abs(rate).max())


def test_the_largest_x_uses_a_reserve_up_and_exceeds_none():
    """In proportions of the least reserve over the joint's largest own lever, scaled until the scarcest is used up."""
    levers = np.array([[[1.0, 2.0], [0.0, 4.0]], [[3.0, 0.0], [1.0, 1.0]]])
    reserves = np.array([[6.0, 4.0], [9.0, 5.0]])
    # proportions (6/3, 4/4) = (2, 1); levers·proportions: (4, 4) and (6, 3); reserves over them: 1.5, 1, 1.5, 5/3
    np.testing.assert_allclose(_within(levers, reserves, np.full(2, np.inf)), [2.0, 1.0])
    np.testing.assert_allclose(_within(levers, 0.5 * reserves, np.full(2, np.inf)), [1.0, 0.5])
    np.testing.assert_allclose(_within(levers, np.array([[6.0, 2.0], [9.0, 5.0]]), np.full(2, np.inf)), [2.0, 0.5])
    # coupling takes more than a joint's own lever: (2, 1) needs 5 of 4
    coupled = np.array([[[1.0, 3.0], [0.0, 1.0]]])
    np.testing.assert_allclose(_within(coupled, np.array([[4.0, 1.0]]), np.array([2.0, np.inf])), [1.6, 0.8])
    np.testing.assert_allclose(_within(levers, reserves, np.array([0.5, 0.25])), [0.5, 0.25])


def test_joints_without_a_velocity_limit_are_taken_to_be_at_rest():
    system = make_system("pera_shoulder")
    speeds = np.array([speed for _, speed in _samples(system, np.array([2.0, np.inf]))])
    assert not speeds[:, 1].any()
    assert -2.0 <= speeds[:, 0].min() < -1.8
    assert 1.8 < speeds[:, 0].max() <= 2.0


def test_motors_that_can_just_hold_an_arm_cannot_brake_it():
    """Nothing is left where the load is largest; with a little more there is a little."""
    system = make_system("pera_gripper")
    velocity = system.robot.velocity_limit
    loads = []
    for q, v in _samples(system, velocity):
        x = system.at(q, v)
        loads.append(np.abs(x.coriolis_matrix @ x.velocity + x.potential_gradient))
    most = np.max(loads, axis=0)
    assert most[0] > 0.0
    with pytest.raises(InvalidArgumentError, match="cannot hold the arm everywhere"):
        braking_acceleration_within(system, most, velocity)
    little = braking_acceleration_within(system, most * (1.0 + 1e-6), velocity)
    inertia = system.at(system.robot.home).mass_matrix[0, 0]
    np.testing.assert_allclose(little, 0.8 * 1e-6 * most / inertia, rtol=1e-6)


@pytest.mark.parametrize("implementation", [_numpy, kernels], ids=["numpy", "chosen"])
def test_turning_with_the_jerk_ends_at_the_bound(implementation):
    """v⁺ + (a − ẇ)²/(2j) = w far from the limits, where w is the velocity limit and ẇ = 0; w itself without a jerk."""
    h, limit = 1e-3, np.array([1.0, 2.0])
    edges, braking = np.full(4, 100.0), np.full(4, 5.0)
    velocity = np.array([0.3, -0.5])
    for jerk in (50.0, 5000.0):
        lowest, highest = implementation.speed_bounds(
            np.zeros(2),
            velocity,
            h,
            edges,
            braking,
            np.zeros(4),
            np.full(4, jerk),
            np.tile(limit, 2),
            0.05,
            np.full(4, -0.2),
        )
        for sign, bound in ((1.0, highest), (-1.0, lowest)):
            speed, following = sign * velocity, sign * bound
            turned = following + ((following - speed) / h) ** 2 / (2.0 * jerk)
            np.testing.assert_allclose(turned, limit, rtol=1e-9)
    lowest, highest = implementation.speed_bounds(
        np.zeros(2),
        velocity,
        h,
        edges,
        braking,
        np.zeros(4),
        np.full(4, np.inf),
        np.tile(limit, 2),
        0.05,
        np.full(4, -0.2),
    )
    np.testing.assert_array_equal([lowest, highest], [-limit, limit])
