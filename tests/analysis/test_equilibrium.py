"""Equilibria found numerically against closed forms and simulations."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, Measured, MechanicalSystem, PHControlError, make_controller, simulate
from phcontrol.analysis.casimirs import casimirs
from phcontrol.analysis.equilibrium import equilibrium
from tests.conftest import make_system
from tests.finite_differences import derivative
from tests.simulation.idle import IdleLaw

FORCE = np.array([3.0, -3.0])
THESIS = {"goal": [1.0, 0.5], "stiffness": 15.0, "damping": 10.0}
SHIFTED = np.array([1.2, 0.3])


@pytest.mark.parametrize(
    ("law", "position"),
    [
        ("energy_shaping", SHIFTED),
        ("force_feedback", [1.0, 0.5]),
        ("force_feedback_measured", SHIFTED),
        ("integral_action", [1.0, 0.5]),
        ("total_force_rejection", [1.0, 0.5]),
    ],
)
def test_equilibria_of_the_shoulder_are_those_of_the_theory(shoulder, law, position):
    controller = make_controller(law, shoulder, **THESIS)
    rest = equilibrium(controller, shoulder, FORCE)
    np.testing.assert_allclose(rest.position, position, atol=1e-9)
    np.testing.assert_allclose(rest.target.rate(FORCE), 0.0, atol=1e-8)  # (2.45)


def test_integral_action_rests_with_the_force_in_its_integral(shoulder):
    rest = equilibrium(make_controller("integral_action", shoulder, **THESIS), shoulder, FORCE)
    np.testing.assert_allclose(rest.controller_state, np.r_[0.0, 0.0, FORCE], atol=1e-9)


@pytest.mark.parametrize("law", ["energy_shaping", "classical_impedance", "force_feedback_measured"])
def test_the_shifted_storage_falls_to_zero_along_a_run(shoulder, law):
    """H_r is the Bregman form: positive, zero at the equilibrium, and here never growing."""
    controller = make_controller(law, shoulder, **THESIS)
    rest = equilibrium(controller, shoulder, FORCE)
    log = simulate(shoulder, controller, duration=25.0, dt=1e-2, disturbance=FORCE)
    shifted = rest.shifted_storage(log)
    assert shifted[0] > 1.0
    assert shifted[-1] == pytest.approx(0.0, abs=1e-8)
    assert shifted.min() >= -1e-12
    assert np.diff(shifted).max() <= 1e-10
    assert np.diff(log.storage).max() > 1e-4  # H_d itself does grow under the force


def test_a_seven_joint_arm_comes_to_rest_where_it_was_computed():
    system = make_system("pera")
    force = np.array([1.0, -2.0, 0.5, 0.5, -0.2, 0.1, 0.1])
    controller = make_controller("energy_shaping", system, goal=system.robot.home, stiffness=30.0)
    rest = equilibrium(controller, system, force)
    np.testing.assert_allclose(rest.position, system.robot.home + force / 30.0, atol=1e-9)


def test_a_wrong_model_shifts_the_equilibrium(shoulder):
    model = MechanicalSystem(shoulder.robot, gravity=[0.0, 0.0, -9.0])
    rest = equilibrium(make_controller("energy_shaping", model, **THESIS), shoulder, np.zeros(2))
    missing = shoulder.at(rest.position).gravity * (1.0 - 9.0 / 9.81)
    np.testing.assert_allclose(rest.position, np.array([1.0, 0.5]) - missing / 15.0, atol=1e-9)


def test_no_equilibrium_is_said_so(shoulder):
    """No torque at all, and a force that gravity (9.5 N·m at most) cannot hold."""
    with pytest.raises(PHControlError, match="found no equilibrium of idle"):
        equilibrium(IdleLaw(shoulder), shoulder, [50.0, 0.0])


def test_bad_input_is_refused(shoulder):
    with pytest.raises(InvalidArgumentError, match="external_force: must have shape"):
        equilibrium(make_controller("energy_shaping", shoulder, **THESIS), shoulder, [1.0])


def growth(rest, law, system, position, velocity, state):
    """Return Ḣ_r along the true motion, by differences: no promise in it."""
    x, force = system.at(position, velocity), rest.external_force
    measured = Measured(external_force=force)
    command = law.evaluate(0.0, x, state, measured)
    acceleration = x.acceleration(command.torque, force)

    def shifted(h):
        there = system.at(x.position + h * x.velocity, x.velocity + h * acceleration)
        own = state + h * command.state_rate
        away = law.coordinates(0.0, there, own, measured) - rest.target.coordinates
        return law.storage(0.0, there, own, measured) - rest.storage - rest.target.gradient @ away

    return float(derivative(shifted, 1e-4))


def greatest_growth(rest, law, system, count):
    draw, n = np.random.default_rng(4), system.n
    return max(
        growth(rest, law, system, system.robot.random_position(draw), draw.normal(size=n), law.random_state(draw))
        for _ in range(count)
    )


def test_the_shifted_storage_of_the_modeled_law_is_refused_where_it_grows():
    """Without friction it grows at some states of the PERA, along the true motion; on one joint it never does."""
    robot = make_system("pera").robot
    system = MechanicalSystem(robot, friction=None)
    law = make_controller("force_feedback", system)
    rest = equilibrium(law, system, [3.0, -2.0, 1.0, 1.0, 0.3, 0.2, 0.1])
    assert not rest.is_lyapunov
    assert rest.growth > 1e-3
    draw, grown = np.random.default_rng(0), 0
    for _ in range(50):  # at momenta near p̂*
        x = system.at(system.robot.random_position(draw))
        momentum = rest.target.momentum + law.coupling @ rest.controller_state + 1e-2 * draw.normal(size=7)
        velocity = np.linalg.solve(x.factor.T, momentum)
        grown += growth(rest, law, system, x.position, velocity, rest.controller_state) > 1e-4
    assert grown > 5
    with pytest.raises(PHControlError, match="no Lyapunov function"):
        rest.shifted_storage(simulate(system, law, duration=0.01))
    gripper = make_system("pera_gripper")
    one = make_controller("force_feedback", gripper)
    resting = equilibrium(one, gripper, [0.2])
    assert resting.is_lyapunov
    assert greatest_growth(resting, one, gripper, 500) < 1e-9


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback_measured", "integral_action"])
def test_it_never_grows_where_it_is_said_to_be_a_lyapunov_function(law):
    system = make_system("pera_shoulder_elbow")
    made = make_controller(law, system)
    rest = equilibrium(made, system, [2.0, -1.0, 0.5])
    assert rest.is_lyapunov
    assert rest.growth <= 1e-9
    assert greatest_growth(rest, made, system, 300) < 1e-6


@pytest.mark.parametrize(
    ("arm", "law", "exist", "linear"),
    [
        ("pera_shoulder", "energy_shaping", True, True),
        ("pera_shoulder", "classical_impedance", True, True),
        ("pera_shoulder", "force_feedback", False, False),
        ("pera_shoulder", "force_feedback_measured", True, True),
        ("pera_shoulder", "integral_action", True, True),
        ("pera_gripper", "force_feedback", True, True),
    ],
)
def test_which_closed_loops_have_the_casimirs_of_theorem_2_4_1(arm, law, exist, linear):
    system = make_system(arm)
    found = casimirs(make_controller(law, system), system)
    assert (found.exist, found.linear) == (exist, linear)


def test_the_asymmetry_of_a_closed_form():
    """Shoulder, A = K_z = C = 1: 𝒦 = [0; T; …], T = diag(√a(q₂), √b): ∂𝒦/∂q₂ = −m l²sin q₂ cos q₂/√a, not symmetric."""
    system = make_system("pera_shoulder")
    law = make_controller("force_feedback", system, coupling=1.0, force_gain=1.0, damping=1.0)
    assert casimirs(law, system).asymmetry > 1e-2
    x = system.at([0.4, 0.8], [0.3, -0.2])
    target = law.target(0.0, x, np.array([0.1, 0.2]))
    K = -np.linalg.solve(target.interconnection - target.dissipation, target.port)
    np.testing.assert_allclose(K, np.vstack([np.zeros((2, 2)), x.factor.T, -x.factor.T]), atol=1e-9)
