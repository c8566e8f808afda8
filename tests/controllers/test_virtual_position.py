"""(4.40) and the port (4.45) of impedance grasping."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import root

from phcontrol import InvalidArgumentError, MechanicalSystem, UnknownNameError, make_controller
from phcontrol.controllers.virtual_position import virtual_position
from phcontrol.sensors.measured import Measured
from tests.conftest import make_system
from tests.finite_differences import derivative, gradient


def test_held_at_a_point_the_spring_presses_with_the_force():
    """Where a stiff spring in space holds the hand, the energy of both springs is least where that presses."""
    system = make_system("pera_shoulder_elbow")
    force, contact, K = np.array([1.0, -2.0, 3.0]), np.array([0.0, 0.7, -1.8]), 20.0
    found = virtual_position(system, "tool", force, K, contact=contact)

    def place(q):
        return np.array(system.at(q).placement("tool").translation)

    held, wall = place(contact), 1e7  # [N/m]

    def pulled(q):
        """Return the gradient of the energy of both springs; the hand's lever is found by differences."""
        return K * (q - found.position) + wall * gradient(place, q) @ (place(q) - held)

    rest = root(pulled, contact, tol=1e-12).x
    assert np.abs(pulled(rest)).max() < 1e-6
    np.testing.assert_allclose(wall * (place(rest) - held), force, rtol=1e-3)
    # the Jacobian of q_f, which (4.40) prints, would press with something else (errata E43)
    there = np.array(system.at(found.position).frame_jacobian("tool", "local_world_aligned"))[:3]
    here = np.array(system.at(contact).frame_jacobian("tool", "local_world_aligned"))[:3]
    assert np.abs(np.linalg.solve(here.T, there.T @ force) - force).max() > 0.05


@pytest.mark.parametrize("arm", ["pera", "panda"])
def test_the_spring_held_at_the_contact_exerts_the_force(arm):
    system = make_system(arm)
    force, contact = np.array([1.0, -2.0, 3.0]), system.robot.home
    frame = "tool" if arm == "pera" else "panda_hand"
    found = virtual_position(system, frame, force, 40.0, contact=contact)
    # power: F·ṙ by differences of the frame's place, for each joint
    lever = gradient(lambda q: np.array(system.at(q).placement(frame).translation), contact)
    np.testing.assert_allclose(40.0 * (found.position - contact), lever @ force, atol=1e-7)
    np.testing.assert_allclose(found.joint_force, lever @ force, atol=1e-7)
    assert np.abs(found.position - contact).max() > 1e-3


def test_moments_count_too_and_bad_input_is_refused():
    system = make_system("pera_shoulder")
    turned = virtual_position(system, "tool", [0.0, 0.0, 0.0, 0.5, 0.0, 0.0], 20.0)
    assert np.abs(turned.joint_force).max() > 0.1
    with pytest.raises(InvalidArgumentError, match="force: must have shape"):
        virtual_position(system, "tool", [1.0, 2.0], 20.0)
    with pytest.raises(UnknownNameError, match="tol"):
        virtual_position(system, "tol", [1.0, 2.0, 3.0], 20.0)


def test_the_port_of_the_rest_length_makes_up_the_energy_of_the_spring(rng):
    """Ḣ_c = (K_p e)ᵀq̇ + y_rlᵀu_rl along the true motion, with an input matrix."""
    robot = make_system("pera_shoulder").robot
    system = MechanicalSystem(robot, input_matrix=[[1.0, 0.3], [-0.2, 0.8]])
    law = make_controller("impedance_grasping", system, goal=[0.2, -0.1], stiffness=3.0, rest_stiffness=0.5)
    for _ in range(5):
        x, rest, force = system.at(rng.normal(size=2), rng.normal(size=2)), rng.normal(size=2), rng.normal(size=2)
        command = law.evaluate(0.0, x, rest, Measured(external_force=force))
        port = law.rest_length_port(0.0, x, rest)
        np.testing.assert_allclose(port.rate, command.state_rate, atol=1e-12)
        acceleration = x.acceleration(command.torque, force)

        def energy(h, x=x, rest=rest, command=command, acceleration=acceleration):
            q = x.position + h * x.velocity + 0.5 * h**2 * acceleration
            r = rest + h * command.state_rate
            e = q - law.goal - r
            return 1.5 * e @ e + 0.25 * r @ r

        by_arm = 3.0 * (x.position - law.goal - rest) @ x.velocity
        assert by_arm + port.power == pytest.approx(float(derivative(energy)), abs=1e-7)
