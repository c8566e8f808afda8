"""The laws against formulas written out by hand, and the checks of their gains."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from phcontrol import (
    NOTHING,
    EnergyShaping,
    ForceFeedback,
    InvalidArgumentError,
    Measured,
    MechanicalSystem,
    MissingMeasurementError,
    NonFiniteTorqueError,
    UnknownNameError,
    load_robot,
    make_controller,
)
from phcontrol.controllers.shaping import EMPTY
from tests.conftest import make_system

GAINS = {"stiffness": 15.0, "damping": 10.0}
EXTENSION = {"coupling": [0.5, 0.7], "force_gain": 2.0}


def random_state(system, rng):
    return system.at(system.robot.random_position(rng), rng.normal(size=system.n))


@pytest.mark.parametrize("form", ["coriolis", "canonical"])
def test_energy_shaping_is_gravity_minus_spring_minus_damper(pera, rng, form):
    goal, x = rng.normal(size=7), random_state(pera, rng)
    controller = EnergyShaping(pera, goal=goal, interconnection=form, **GAINS)
    expected = x.gravity - 15.0 * (x.position - goal) - 10.0 * x.velocity
    np.testing.assert_allclose(controller.evaluate(0.0, x, EMPTY).torque, expected, atol=1e-12)


@pytest.mark.parametrize("measured", [False, True])
def test_force_feedback_is_the_formula_of_section_4_2(shoulder, rng, measured):
    """u = ∂V/∂q − K_p q̃ + T A ż − C(q̇ − T⁻ᵀA z) with M = diag(a(q₂), b), written out for the shoulder."""
    goal, z, force = rng.normal(size=(3, 2))
    x = random_state(shoulder, rng)
    mass, length, inertia = 3.9, 0.249, (0.013, 1.692)
    a = mass * length**2 * np.cos(x.position[1]) ** 2 + sum(inertia)
    T = np.sqrt([a, mass * length**2 + inertia[1]])  # diagonal of T
    a_slope = -2.0 * mass * length**2 * np.cos(x.position[1]) * np.sin(x.position[1])  # da/dq₂
    v = x.velocity
    coriolis = np.array([a_slope * v[0] * v[1], -0.5 * a_slope * v[0] ** 2])  # Cq̇ of Euler and Lagrange
    T_rate = np.array([0.5 * a_slope * v[1] / T[0], 0.0])
    spring = -15.0 * (x.position - goal)
    friction = shoulder.friction.coefficients(v) * v
    f_bar = (spring - coriolis - friction + (force if measured else 0.0)) / T + T_rate * v
    A, Kz = np.array([0.5, 0.7]), 2.0
    z_rate = A * Kz * f_bar
    g = (
        9.81
        * mass
        * length
        * np.array([np.cos(x.position[1]) * np.sin(x.position[0]), np.sin(x.position[1]) * np.cos(x.position[0])])
    )
    expected = g + spring + T * A * z_rate - 10.0 * (v - A * z / T)
    controller = ForceFeedback(shoulder, goal=goal, measured=measured, **GAINS, **EXTENSION)
    command = controller.evaluate(0.0, x, z, Measured(external_force=force))
    np.testing.assert_allclose(command.torque, expected, atol=1e-12)
    np.testing.assert_allclose(command.state_rate, z_rate, atol=1e-12)


def test_laws_act_through_the_input_matrix(rng):
    """With gears G the motors' torques G u are the same desired joint torques; damping acts on y = Gᵀq̇."""
    G = np.array([[1.0, 0.5], [0.0, 2.0]])
    robot = load_robot("pera_shoulder")
    geared = MechanicalSystem(robot, input_matrix=G)
    goal, x = rng.normal(size=2), random_state(geared, rng)
    u = EnergyShaping(geared, goal=goal, **GAINS).evaluate(0.0, x, EMPTY).torque
    expected = np.linalg.solve(G, x.gravity - 15.0 * (x.position - goal)) - 10.0 * (G.T @ x.velocity)
    np.testing.assert_allclose(u, expected, atol=1e-12)


def test_evaluation_is_pure(pera, rng):
    controller = make_controller("force_feedback", pera)
    x, z = random_state(pera, rng), rng.normal(size=7)
    first = controller.evaluate(0.0, x, z)
    controller.evaluate(1.0, random_state(pera, rng), -z)
    again = controller.evaluate(0.0, pera.at(x.position, x.velocity), z)
    np.testing.assert_array_equal(first.torque, again.torque)
    np.testing.assert_array_equal(first.state_rate, again.state_rate)


def test_gains_may_be_scalar_vector_or_matrix_and_are_copied(shoulder, rng):
    x, goal = random_state(shoulder, rng), np.zeros(2)
    torques = []
    for stiffness in (15.0, [15.0, 15.0], 15.0 * np.eye(2)):
        controller = EnergyShaping(shoulder, goal=goal, stiffness=stiffness, damping=1.0)
        torques.append(controller.evaluate(0.0, x, EMPTY).torque)
    np.testing.assert_array_equal(torques[0], torques[1])
    np.testing.assert_array_equal(torques[0], torques[2])
    goal[0] = 99.0
    assert controller.goal[0] == 0.0


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"stiffness": -1.0}, "stiffness: must be positive definite, but its smallest eigenvalue is -1"),
        ({"stiffness": 0.0}, "stiffness: must be positive definite"),
        ({"stiffness": np.ones((7, 6))}, r"stiffness: must be a scalar, a vector of length 2.*has shape \(7, 6\)"),
        ({"stiffness": [[1.0, 2.0], [0.0, 1.0]]}, "stiffness: must be symmetric"),
        ({"stiffness": [[1.0, 2.0], [2.0, 1.0]]}, "stiffness: must be positive definite"),
        ({"damping": np.nan}, "damping: must be finite"),
        ({"damping": "much"}, "damping: must be an array of real numbers"),
        ({"goal": [1.0]}, r"goal: must have shape \(2,\)"),
        ({"coupling": [1.0, 0.0]}, "coupling: must be invertible"),
        ({"force_gain": -2.0}, "force_gain: must be positive definite"),
        ({"measured": "yes"}, "measured: must be True or False"),
    ],
)
def test_bad_gains_are_refused(shoulder, change, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        ForceFeedback(shoulder, **({"goal": [0.0, 0.0]} | GAINS | EXTENSION | change))


def test_unknown_names_are_refused_and_the_known_ones_listed(shoulder):
    with pytest.raises(
        UnknownNameError, match="unknown controller 'pid'.*energy_shaping, force_control, force_feedback"
    ):
        make_controller("pid", shoulder)
    with pytest.raises(UnknownNameError, match=r"unknown option 'stifness'.*Did you mean 'stiffness'\?.*coupling"):
        make_controller("force_feedback", shoulder, stifness=3.0)
    with pytest.raises(UnknownNameError, match="unknown interconnection"):
        make_controller("force_feedback", shoulder, interconnection="fast")
    with pytest.raises(InvalidArgumentError, match="system: must be a MechanicalSystem, but is Robot"):
        EnergyShaping(shoulder.robot, goal=[0, 0], **GAINS)


def test_a_missing_measurement_is_named(shoulder):
    controller = make_controller("force_feedback_measured", shoulder)
    with pytest.raises(MissingMeasurementError, match="force_feedback needs the measurement 'external_force'"):
        controller.evaluate(0.0, shoulder.at([0.0, 0.0]), np.zeros(2), NOTHING)


def test_a_torque_that_is_not_finite_never_leaves(shoulder):
    controller = make_controller("force_feedback", shoulder)
    with pytest.raises(NonFiniteTorqueError, match=r"not finite at t = 2 s \(torque = .*controller_state = \[nan"):
        controller.evaluate(2.0, shoulder.at([0.0, 0.0]), np.array([np.nan, 0.0]))


def test_total_force_rejection_needs_no_model_of_gravity_and_friction(shoulder, rng):
    """u = −f + Ṫp̄ − K_p q̃ − C q̇ (errata E7), with f measured: another gravity in the model changes nothing."""
    blind = MechanicalSystem(shoulder.robot, friction=None, gravity=[0.0, 0.0, 0.0])
    q, v, force = rng.normal(size=(3, 2))
    measured = Measured(total_force=shoulder.at(q, v).total_force(force))
    torques = [
        make_controller("total_force_rejection", system, [1.0, 0.5], stiffness=15.0, damping=10.0)
        .evaluate(0.0, system.at(q, v), EMPTY, measured)
        .torque
        for system in (shoulder, blind)
    ]
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-12)


positive = st.floats(0.05, 50.0)
gain_matrices = st.lists(st.floats(-3, 3), min_size=9, max_size=9).map(lambda entries: np.reshape(entries, (3, 3)))


def storage_rate(controller, x, state):
    """Ḣ_d = ∇H_dᵀẋ under the true dynamics, relative to the powers it is made of."""
    h = 1e-5
    command = controller.evaluate(0.0, x, state)
    acceleration = x.acceleration(command.torque)

    def coordinates(t):
        moved = x.system.at(x.position + t * x.velocity, x.velocity + t * acceleration)
        return controller.coordinates(0.0, moved, state + t * command.state_rate)

    rates = (coordinates(h) - coordinates(-h)) / (2.0 * h)
    parts = controller.target(0.0, x, state).gradient * rates
    return parts.sum() / np.abs(parts).sum()


@given(stiffness=positive, damping=positive, a=positive, kz=positive, seed=st.integers(0, 2**32 - 1))
def test_storage_never_grows_whatever_the_gains(stiffness, damping, a, kz, seed):
    system, rng = make_system("pera_shoulder_elbow"), np.random.default_rng(seed)
    controller = ForceFeedback(
        system, goal=rng.normal(size=3), stiffness=stiffness, damping=damping, coupling=a, force_gain=kz
    )
    assert storage_rate(controller, random_state(system, rng), rng.normal(size=3)) <= 1e-6


@given(root=gain_matrices, integral=gain_matrices, seed=st.integers(0, 2**32 - 1))
def test_integral_gains_inside_the_condition_never_make_the_storage_grow_and_others_are_refused(root, integral, seed):
    """K_iᵀK_p + K_pK_i > 0 is what the storage function needs, and what the constructor asks for."""
    system, rng = make_system("pera_shoulder_elbow"), np.random.default_rng(seed)
    stiffness = root @ root.T + np.eye(3)
    product = stiffness @ integral
    smallest = np.linalg.eigvalsh(product + product.T)[0]
    assume(abs(smallest) > 1e-9)

    def make():
        return make_controller(
            "integral_action", system, rng.normal(size=3), stiffness=stiffness, integral_gain=integral
        )

    if smallest < 0.0:
        with pytest.raises(InvalidArgumentError, match="integral_gain: K_iᵀK_p \\+ K_pK_i must be positive definite"):
            make()
    else:
        assert storage_rate(make(), random_state(system, rng), rng.normal(size=6)) <= 1e-6
