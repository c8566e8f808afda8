"""Reflected rotor inertia is part of M everywhere: in M, in forward and inverse dynamics, in energies and laws."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import InvalidArgumentError, MechanicalSystem, UnknownNameError, certify, load_robot, make_controller
from phcontrol.controllers.registry import CONTROLLERS, laws_for
from phcontrol.simulation.closed_loop import simulate
from tests.finite_differences import gradient

ARMS = ("ur5", "panda", "kinova", "pera")  # panda: a mimic and a prismatic joint; kinova: continuous joints


def pair(arm):
    """The arm with no rotors, and with a different one at each joint."""
    plain = MechanicalSystem(load_robot(arm, armature=0.0))
    rotors = 0.05 * (1.0 + np.arange(plain.n))
    return plain, MechanicalSystem(load_robot(arm, armature=rotors)), rotors


@pytest.mark.parametrize("arm", ARMS)
def test_it_is_in_the_mass_matrix_and_in_nothing_else(arm, rng):
    plain, geared, rotors = pair(arm)
    q, v = plain.robot.random_position(rng), rng.normal(size=plain.n)
    a, b = plain.at(q, v), geared.at(q, v)
    np.testing.assert_allclose(b.mass_matrix, a.mass_matrix + np.diag(rotors), atol=1e-13)
    np.testing.assert_allclose(b.coriolis_matrix, a.coriolis_matrix, atol=1e-13)
    np.testing.assert_allclose(b.potential_gradient, a.potential_gradient, atol=1e-13)
    np.testing.assert_allclose(b.factor @ b.factor.T, b.mass_matrix, atol=1e-12)
    assert b.kinetic_energy == pytest.approx(a.kinetic_energy + 0.5 * v @ (rotors * v))
    expected = gradient(lambda y: geared.at(y).factor, q)
    np.testing.assert_allclose(b.factor_derivative, expected, atol=1e-7)


@pytest.mark.parametrize("arm", ARMS)
def test_it_is_in_forward_and_inverse_dynamics(arm, rng):
    """M q̈ + C q̇ + D q̇ + ∂V/∂q = u with M from the test above."""
    _, system, _ = pair(arm)
    x, u = system.at(system.robot.random_position(rng), rng.normal(size=system.n)), rng.normal(size=system.n)
    acceleration = x.acceleration(u)
    balance = (
        x.mass_matrix @ acceleration + x.coriolis_matrix @ x.velocity + x.friction_torque + x.potential_gradient - u
    )
    assert np.abs(balance).max() <= 1e-10 * max(1.0, np.abs(acceleration).max())
    np.testing.assert_allclose(x.feedforward(x.velocity, acceleration), u, atol=1e-9)
    np.testing.assert_allclose(
        x.momentum_rate(u), x.mass_matrix @ acceleration + x.mass_matrix_rate @ x.velocity, atol=1e-9
    )


def test_pinocchio_has_it_in_every_algorithm_that_is_used(rng):
    """aba, rnea, crba and the joint-torque regressor's rotor part agree on one model (their versions must, too)."""
    _, system, rotors = pair("ur5")
    model, data = system.model, system.model.createData()
    q, v, a = rng.normal(size=(3, 6))
    without = model.copy()
    without.armature = np.zeros(6)
    difference = pin.rnea(model, data, q, v, a) - pin.rnea(without, without.createData(), q, v, a)
    np.testing.assert_allclose(difference, rotors * a, atol=1e-12)
    np.testing.assert_allclose(pin.aba(model, data, q, v, pin.rnea(model, data, q, v, a)), a, atol=1e-9)


def test_a_heavy_rotor_decides_how_fast_a_joint_falls():
    """With I = 100 kg m² at the rotor the acceleration is −g(q)/I to a percent."""
    system = MechanicalSystem(load_robot("pera_shoulder", armature=100.0), friction=None)
    x = system.at([0.5, 0.3])
    np.testing.assert_allclose(x.acceleration(np.zeros(2)), -x.gravity / 100.0, rtol=0.02)


@pytest.mark.parametrize("law", [name for name in CONTROLLERS if name.startswith(("tracking", "force_feedback"))])
def test_laws_are_certified_with_it(law):
    for form in CONTROLLERS[law].law.forms:
        for arm in ("ur5", "panda"):
            _, system, _ = pair(arm)
            certificate = certify(make_controller(law, system, interconnection=form), samples=4)
            assert certificate.passed, str(certificate)


def test_a_run_balances_its_power_with_it():
    _, system, _ = pair("panda")
    law = make_controller("tracking", system, bandwidth=4.0)
    log = simulate(system, law, duration=0.5, q0=system.robot.near_home())
    assert log.power_balance("plant").relative_residual < 1e-6
    assert log.power_balance("storage").relative_residual < 1e-6


def test_by_joint_name_the_others_keep_theirs():
    described = load_robot("talos_arm")
    name = described.joint_names[2]
    changed = load_robot("talos_arm", armature={name: 0.7})
    expected = np.array(described.model.armature)
    expected[2] = 0.7
    np.testing.assert_array_equal(changed.model.armature, expected)
    with pytest.raises(UnknownNameError, match="unknown joint 'elbow' of talos_arm"):
        load_robot("talos_arm", armature={"elbow": 0.1})
    with pytest.raises(InvalidArgumentError, match="armature: must be >= 0"):
        load_robot("talos_arm", armature={name: -0.1})


def test_a_prismatic_arm_tracks_and_is_certified(tmp_path):
    """A cart with a pendulum on it, actuated both: one joint in metres, one in radians; M known in closed form."""
    inertial = (
        '<inertial><origin xyz="{x} 0 0"/><mass value="{m}"/>'
        '<inertia ixx="0.1" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    limit = '<limit lower="-2" upper="2" effort="100" velocity="3"/>'
    path = tmp_path / "cart.urdf"
    path.write_text(
        '<robot name="cart"><link name="base"/>'
        f'<link name="cart">{inertial.format(x=0.0, m=3.0)}</link>'
        f'<link name="pole">{inertial.format(x=0.5, m=2.0)}</link>'
        '<joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/>'
        f'<axis xyz="1 0 0"/>{limit}</joint>'
        '<joint name="swing" type="revolute"><parent link="cart"/><child link="pole"/>'
        f'<axis xyz="0 1 0"/>{limit}</joint></robot>'
    )
    system = MechanicalSystem(load_robot(path, armature={"slide": 0.4, "swing": 0.3}))
    assert system.robot.prismatic == (True, False)
    angle = 0.6
    coupling = -2.0 * 0.5 * np.sin(angle)  # of the pole's centre of mass, along the slide
    expected = [[3.0 + 2.0 + 0.4, coupling], [coupling, 0.2 + 2.0 * 0.25 + 0.3]]
    np.testing.assert_allclose(system.at([0.1, angle]).mass_matrix, expected, atol=1e-12)
    for law in laws_for(system):
        for form in CONTROLLERS[law].law.forms:
            assert certify(make_controller(law, system, interconnection=form), samples=4).passed, (law, form)
    law = make_controller("tracking", system)
    log = simulate(system, law, duration=5.0, dt=5e-3, q0=[0.1, 0.2])
    np.testing.assert_allclose(log.position[-1], law.trajectory.at(5.0).position, atol=1e-4)
