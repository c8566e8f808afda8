"""A full D(q, q̇) in the plant, in every law's promise, and its refusals."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    CONTROLLERS,
    InvalidArgumentError,
    MatrixDamping,
    MechanicalSystem,
    StribeckFriction,
    TorqueFilter,
    certify,
    l2_gain,
    load_robot,
    make_controller,
    simulate,
)
from tests.finite_differences import derivative


def dragged(name="pera_shoulder_elbow"):
    """Return an arm whose flat hand is dragged through a liquid, 𝒥ᵀd𝒥(1 + |q̇|²), and whose joints rub a little."""
    bare = MechanicalSystem(load_robot(name), friction=None)

    def drag(position, velocity):
        lever = bare.twin().at(position).frame_jacobian("tool", "local_world_aligned")[:3]
        return (lever.T @ np.diag([20.0, 2.0, 6.0]) @ lever) * (1.0 + velocity @ velocity) + 0.1 * np.eye(len(position))

    return MechanicalSystem(load_robot(name), friction=MatrixDamping(drag)), drag


def test_the_plant_loses_the_power_of_the_drag(rng):
    """Ḣ = −q̇ᵀD q̇ along the free motion, D not diagonal; p̄̇ as (2.35) has it."""
    system, drag = dragged()
    for _ in range(3):
        x = system.at(system.robot.random_position(rng), rng.normal(size=3))
        D, acceleration = drag(x.position, x.velocity), x.acceleration(np.zeros(3))
        assert np.abs(D - np.diag(np.diag(D))).max() > 0.1

        def later(h, x=x, acceleration=acceleration):
            return system.at(x.position + h * x.velocity, x.velocity + h * acceleration)

        rate = derivative(lambda h: np.array(later(h).energy))
        assert rate == pytest.approx(-x.velocity @ D @ x.velocity, rel=1e-7)
        moved = derivative(lambda h: later(h).transformed_momentum)
        np.testing.assert_allclose(x.transformed_rate(-x.potential_gradient), moved, atol=1e-6)
        np.testing.assert_allclose(x.feedforward(x.velocity, acceleration), 0.0, atol=1e-9)
        np.testing.assert_allclose(x.damping, np.diag(D), rtol=1e-12)


def test_a_diagonal_matrix_is_the_friction_of_each_joint(rng):
    one = MechanicalSystem(load_robot("pera"), friction=StribeckFriction(viscous=np.arange(1.0, 8.0)))
    other = MechanicalSystem(load_robot("pera"), friction=MatrixDamping(np.diag(np.arange(1.0, 8.0))))
    q, v, u = one.robot.random_position(rng), rng.normal(size=7), rng.normal(size=7)
    np.testing.assert_array_equal(one.at(q, v).acceleration(u), other.at(q, v).acceleration(u))


@pytest.mark.parametrize(
    ("name", "form"),
    [
        (name, form)
        for name, entry in CONTROLLERS.items()
        if entry.minimum_joints == 1
        for form in ("coriolis", "canonical")
        if form in entry.law.forms
    ],
)
def test_every_law_is_what_it_promises_with_it(name, form):
    system, _ = dragged("pera_shoulder")
    certificate = certify(make_controller(name, system, interconnection=form), samples=48)
    assert certificate.passed, certificate


def test_a_law_that_knows_the_diagonal_only_has_no_certificate():
    system, drag = dragged("pera_shoulder")
    diagonal = MatrixDamping(lambda q, v: np.diag(np.diag(drag(q, v))))
    model = MechanicalSystem(system.robot, friction=diagonal)
    assert not certify(make_controller("force_feedback", model), system, samples=32).passed


def test_the_balance_of_a_run_closes_and_the_gain_is_bounded():
    system, _ = dragged("pera_shoulder")
    law = make_controller("force_feedback", system)
    log = simulate(system, law, duration=1.0, dt=1e-3, q0=[0.5, 0.3], disturbance=[1.0, -1.0])
    assert log.power_balance().relative_residual < 1e-5
    assert l2_gain(law, system).passed


def test_what_is_no_damping_is_refused():
    robot = load_robot("pera_shoulder")
    for matrix, complaint in (
        (np.eye(3), "shape"),
        ([[1.0, 0.5], [0.0, 1.0]], "symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], "positive semidefinite"),
        (lambda q, v: np.full((2, 2), np.nan), "finite"),
    ):
        with pytest.raises(InvalidArgumentError, match=f"friction: .*{complaint}"):
            MechanicalSystem(robot, friction=MatrixDamping(matrix))
    system, _ = dragged("pera_shoulder")
    with pytest.raises(InvalidArgumentError, match="friction: couples the joints"):
        TorqueFilter(system, period=1e-3)
