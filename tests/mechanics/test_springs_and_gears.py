"""What springs, friction and gears do to a state, against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import GripperSpring, InvalidArgumentError, MechanicalSystem, StribeckFriction, load_robot
from phcontrol.mechanics.friction import check_size
from phcontrol.mechanics.potentials import OnJoint

SPRING = GripperSpring(closing_stiffness=4.0, opening_stiffness=4.0, rest_angle=0.5, smoothing=1e-3)  # plainly linear


def test_a_spring_on_one_joint_pulls_that_joint_alone():
    robot = load_robot("pera_shoulder_elbow")
    sprung, plain = MechanicalSystem(robot, potentials=[OnJoint(SPRING, 1)]), MechanicalSystem(robot)
    q, v = np.array([0.1, 0.9, -0.3]), np.array([0.2, -0.1, 0.4])
    x, y = sprung.at(q, v), plain.at(q, v)
    pull = np.array([0.0, 4.0 * 0.4, 0.0])
    np.testing.assert_allclose(x.potential_gradient - y.potential_gradient, pull, atol=1e-12)
    assert x.potential_energy - y.potential_energy == pytest.approx(2.0 * 0.4**2)
    torque = np.array([1.0, 2.0, 3.0])
    expected = np.linalg.solve(y.mass_matrix, -pull)
    np.testing.assert_allclose(x.acceleration(torque) - y.acceleration(torque), expected, atol=1e-9)
    np.testing.assert_allclose(x.total_force() - y.total_force(), -pull, atol=1e-12)
    np.testing.assert_allclose(x.applied_force(torque) - y.applied_force(torque), -pull, atol=1e-12)
    np.testing.assert_allclose(x.feedforward(v, v) - y.feedforward(v, v), pull, atol=1e-12)
    np.testing.assert_array_equal(x.gravity, y.gravity)


def test_gears_turn_torques_and_the_damping_behind_them():
    G = np.array([[2.0, 0.5], [0.0, 4.0]])
    system = MechanicalSystem(load_robot("pera_shoulder"), input_matrix=G)
    x, plain = (
        system.at([0.1, 0.2], [0.3, -0.4]),
        MechanicalSystem(load_robot("pera_shoulder")).at([0.1, 0.2], [0.3, -0.4]),
    )
    torque = np.array([1.0, -1.0])
    np.testing.assert_allclose(system.motor_torque(G @ torque), torque, atol=1e-12)
    np.testing.assert_allclose(x.applied_force(torque), plain.applied_force([1.5, -4.0]), atol=1e-12)
    np.testing.assert_allclose(x.momentum_rate(torque), plain.momentum_rate(np.array([1.5, -4.0])), atol=1e-12)
    np.testing.assert_allclose(x.output, [0.6, 0.15 - 1.6], atol=1e-12)
    C = np.diag([3.0, 5.0])
    np.testing.assert_allclose(x.injected_damping(C, x.velocity), G @ C @ G.T @ [0.3, -0.4], atol=1e-12)
    np.testing.assert_allclose(plain.injected_damping(C, x.velocity), [0.9, -2.0], atol=1e-12)
    for matrix in (np.ones((2, 2)), np.diag([1.0, 1e-13])):
        with pytest.raises(InvalidArgumentError, match="input_matrix: must be invertible"):
            MechanicalSystem(system.robot, input_matrix=matrix)
    MechanicalSystem(system.robot, input_matrix=np.diag([1.0, 1e-11]))


def test_an_arm_without_friction_loses_nothing():
    x = MechanicalSystem(load_robot("pera_shoulder"), friction=None).at([0.1, 0.2], [0.3, -0.4])
    np.testing.assert_array_equal(x.damping, np.zeros(x.system.n))
    np.testing.assert_array_equal(x.friction_torque, [0.0, 0.0])
    np.testing.assert_array_equal(x.damping_matrix, np.zeros((2, 2)))
    for form in ("coriolis", "canonical"):
        s = np.array([0.5, 0.7])
        expected = x.interconnection(form) @ x.factor.T @ s
        np.testing.assert_allclose(x.structure_rate(form, s), expected, atol=1e-12)


def test_parameters_of_friction_have_the_arms_size():
    for name in ("viscous", "coulomb", "stribeck_velocity"):
        friction = StribeckFriction(**{name: [1.0, 2.0]})
        check_size(friction, 2)
        with pytest.raises(InvalidArgumentError, match=rf"friction\.{name}: must have shape \(3,\)"):
            MechanicalSystem(load_robot("pera_shoulder_elbow"), friction=friction)
    with pytest.raises(InvalidArgumentError, match="friction: needs numbers, or vectors of one length"):
        StribeckFriction(viscous=[1.0, 2.0], coulomb=[1.0, 2.0, 3.0])
    with pytest.raises(InvalidArgumentError, match="smoothing: .* is too small for a static friction"):
        StribeckFriction(coulomb=1e300, smoothing=1e-300)
    for friction in ("own", 3.0):
        with pytest.raises(InvalidArgumentError, match="friction: must be a friction model, None or 'robot'"):
            MechanicalSystem(load_robot("pera_shoulder"), friction=friction)


def test_usual_friction_is_smoothed_over_thirty_milliradians_a_second():
    """α_f = 1e-3 rad²/s², and without a static friction no Stribeck effect."""
    speed = np.array([0.05])
    np.testing.assert_allclose(StribeckFriction(coulomb=2.0).coefficients(speed), 2.0 / np.sqrt(1e-3 + 0.05**2))
    curve = (2.0 + 1.0 * np.exp(-0.5)) / np.sqrt(1e-3 + 0.05**2) + 0.3
    np.testing.assert_allclose(StribeckFriction(coulomb=2.0, static=3.0, viscous=0.3).coefficients(speed), curve)
    viscous = StribeckFriction(viscous=0.3)
    np.testing.assert_array_equal(viscous.coefficients(np.array([0.0, 5.0])), [0.3, 0.3])
