"""Mechanical quantities on every arm, against finite differences and forward dynamics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import InvalidArgumentError, MechanicalSystem, StribeckFriction, UnknownNameError, load_robot
from phcontrol.mechanics.robot import REFERENCES
from phcontrol.mechanics.state import INTERCONNECTIONS
from tests.conftest import make_system
from tests.finite_differences import derivative, gradient, relative_error

DERIVATIVE = 1e-7  # relative; fourth-order differences leave about 1e-11
STATES = 5


def states(system, rng, count=STATES):
    for _ in range(count):
        yield system.at(system.robot.random_position(rng), rng.normal(size=system.n))


def test_factor_is_lower_triangular_and_squares_to_the_mass_matrix(system, rng):
    for x in states(system, rng):
        np.testing.assert_array_equal(np.triu(x.factor, 1), 0.0)
        np.testing.assert_allclose(x.factor @ x.factor.T, x.mass_matrix, atol=1e-12 * np.abs(x.mass_matrix).max())


def test_gravity_and_springs_are_the_gradient_of_the_potential(system, rng):
    for x in states(system, rng):
        expected = gradient(lambda q: system.at(q).potential_energy, x.position)
        assert relative_error(x.potential_gradient, expected) < DERIVATIVE


def test_mass_matrix_derivative(system, rng):
    for x in states(system, rng):
        expected = gradient(lambda q: system.at(q).mass_matrix, x.position)
        assert relative_error(x.mass_matrix_derivative, expected) < DERIVATIVE


def test_factor_derivative(system, rng):
    for x in states(system, rng):
        expected = gradient(lambda q: system.at(q).factor, x.position)
        assert relative_error(x.factor_derivative, expected) < DERIVATIVE


def test_rates_of_mass_matrix_and_factor(system, rng):
    for x in states(system, rng):
        assert relative_error(x.mass_matrix_rate, along(x, lambda y: y.mass_matrix)) < DERIVATIVE
        assert relative_error(x.factor_rate, along(x, lambda y: y.factor)) < DERIVATIVE


def along(x, quantity):
    """Rate of a quantity of the state along q̇, by differences."""
    return derivative(lambda h: quantity(x.system.at(x.position + h * x.velocity, x.velocity)))


@pytest.mark.parametrize("reference", list(REFERENCES))
def test_frame_jacobian_its_rate_and_its_derivative(system, rng, reference):
    frames = system.robot.frame_names
    for frame in {frames[-1], frames[len(frames) // 2], system.robot.tool_frame or frames[-1]}:
        for x in states(system, rng, 3):
            jacobian = x.frame_jacobian(frame, reference)
            expected = gradient(lambda q, frame=frame: system.at(q).frame_jacobian(frame, reference), x.position)
            assert relative_error(x.frame_jacobian_derivative(frame, reference), expected) < DERIVATIVE
            rate = np.tensordot(x.velocity, expected, axes=1)
            assert relative_error(x.frame_jacobian_rate(frame, reference), rate) < DERIVATIVE
            if reference == "local_world_aligned":
                velocity = along(x, lambda y, frame=frame: y.placement(frame).translation)
                np.testing.assert_allclose(jacobian[:3] @ x.velocity, velocity, atol=1e-8)


@pytest.mark.parametrize("form", INTERCONNECTIONS)
def test_interconnection_is_skew(system, rng, form):
    for x in states(system, rng):
        matrix = x.interconnection(form)
        assert np.abs(matrix + matrix.T).max() <= 1e-13 * max(1.0, np.abs(matrix).max())


@pytest.mark.parametrize("form", INTERCONNECTIONS)
def test_transformed_dynamics_are_the_forward_dynamics(system, rng, form):
    """p̄̇ of theory section 2 equals Tᵀq̈ + Ṫᵀq̇ with q̈ from the articulated-body algorithm."""
    for x in states(system, rng):
        torque, force = rng.normal(size=system.n), rng.normal(size=system.n)
        from_dynamics = x.factor.T @ forward_dynamics(x, torque, force) + x.factor_rate.T @ x.velocity
        from_structure = (
            -x.solve_factor(x.potential_gradient)
            + (x.interconnection(form) - x.transformed_damping) @ x.transformed_momentum
            + x.transformed_input @ torque
            + x.solve_factor(force)
        )
        scale = max(1.0, np.abs(from_dynamics).max())
        assert np.abs(from_dynamics - from_structure).max() <= 1e-10 * scale


def forward_dynamics(x, torque, force):
    """q̈ independently of MechanicalState: aba on the model, or for mimic joints M and rnea by hand."""
    system, q, v = x.system, x.position, x.velocity
    applied = torque + force
    if system.friction is not None:
        applied = applied - system.friction.coefficients(v) * v
    for potential in system.potentials:
        applied = applied - potential.gradient(q)
    data = system.model.createData()
    if system.coupling is None:
        return pin.aba(system.model, data, q, v, applied)
    E, full = system.coupling.matrix, system.robot.full_position(q)
    bias = E.T @ pin.rnea(system.model, data, full, E @ v, np.zeros(system.model.nv))
    return np.linalg.solve(E.T @ pin.crba(system.model, data, full) @ E, applied - bias)


def test_momentum_derivative_is_that_at_constant_momentum(system, rng):
    """Errata E6: P = ∂(T⁻¹p)/∂q at constant p, not at constant p̄."""
    for x in states(system, rng):
        p = x.momentum
        expected = gradient(lambda q, p=p: np.linalg.solve(system.at(q).factor, p), x.position).T
        assert relative_error(x.momentum_derivative, expected) < DERIVATIVE


def test_accelerations_and_momentum_rates_agree(system, rng):
    for x in states(system, rng):
        torque, force = rng.normal(size=system.n), rng.normal(size=system.n)
        acceleration = x.acceleration(torque, force)
        np.testing.assert_allclose(
            acceleration, forward_dynamics(x, torque, force), atol=1e-9 * max(1.0, np.abs(acceleration).max())
        )
        momentum_rate = x.mass_matrix @ acceleration + x.mass_matrix_rate @ x.velocity
        np.testing.assert_allclose(x.momentum_rate(torque, force), momentum_rate, atol=1e-9)


def test_energies(system, rng):
    for x in states(system, rng):
        assert x.kinetic_energy == pytest.approx(0.5 * x.transformed_momentum @ x.transformed_momentum)
        assert x.energy == x.kinetic_energy + x.potential_energy


def test_input_matrix_enters_the_dynamics(rng):
    robot = load_robot("pera_shoulder")
    G = np.array([[1.0, 0.5], [0.0, 2.0]])
    plain, geared = MechanicalSystem(robot), MechanicalSystem(robot, input_matrix=G)
    q, v, u = rng.normal(size=(3, 2))
    np.testing.assert_allclose(geared.at(q, v).acceleration(u), plain.at(q, v).acceleration(G @ u))
    np.testing.assert_allclose(geared.at(q, v).output, G.T @ v)


def test_armature_is_part_of_the_mass_matrix():
    plain, geared = (MechanicalSystem(load_robot("ur5", armature=value)) for value in (0.0, 0.25))
    np.testing.assert_allclose(geared.at(np.zeros(6)).mass_matrix, plain.at(np.zeros(6)).mass_matrix + 0.25 * np.eye(6))


def test_errors_of_continuous_joints_are_wrapped():
    system = MechanicalSystem(load_robot("kinova"))
    continuous = system.robot.continuous
    assert continuous.any()
    assert not continuous.all()
    x = system.at(np.full(6, 3.0))
    error = x.position_error(np.full(6, -3.0))
    np.testing.assert_allclose(error, np.where(continuous, 6.0 - 2.0 * np.pi, 6.0))


def test_errors_of_continuous_joints_are_those_of_pinocchio_on_the_circle(rng):
    """q ⊖ q_d by Pinocchio's ``difference`` on the same URDF, where a continuous joint is a cosine and a sine."""
    robot = load_robot("kinova")
    model = pin.buildModelFromUrdf(str(robot.path))
    assert model.nq > model.nv == robot.n

    def on_the_circle(q):
        parts = [[np.cos(a), np.sin(a)] if turning else [a] for a, turning in zip(q, robot.continuous, strict=True)]
        return np.concatenate(parts)

    for _ in range(20):
        a, b = rng.uniform(-10.0, 10.0, size=(2, robot.n))
        expected = pin.difference(model, on_the_circle(b), on_the_circle(a))
        np.testing.assert_allclose(robot.difference(a, b), expected, atol=1e-9)


def test_states_copy_what_they_are_given(pera):
    q = np.zeros(7)
    x = pera.at(q)
    q[0] = 1.0
    assert x.position[0] == 0.0


@pytest.mark.parametrize(
    ("position", "velocity", "complaint"),
    [
        (np.full(7, np.nan), None, "position: must be finite, but is nan at index 0"),
        (np.zeros(6), None, r"position: must have shape \(7,\), but has shape \(6,\)"),
        (np.zeros((7, 1)), None, r"position: must have shape \(7,\)"),
        (np.zeros(7), np.r_[np.zeros(6), np.inf], "velocity: must be finite, but is inf at index 6"),
        (np.zeros(7), np.zeros(8), r"velocity: must have shape \(7,\), but has shape \(8,\)"),
        (["a"] * 7, None, "position: must be an array of real numbers"),
        (np.zeros(7, dtype=complex), None, "position: must be an array of real numbers"),
    ],
)
def test_bad_states_are_refused(pera, position, velocity, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        pera.at(position, velocity)


def test_integers_and_lists_are_converted_and_huge_finite_numbers_accepted(shoulder):
    assert shoulder.at([1, 0]).position.dtype == np.float64
    assert shoulder.at(np.array([1, 0])).mass_matrix.shape == (2, 2)
    assert shoulder.at(np.array([1.0, 0.0]), np.array([1e150, 1e150])).velocity[0] == 1e150


def test_unknown_names_are_listed(pera):
    with pytest.raises(UnknownNameError, match=r"unknown frame 'hnad' of pera\. Did you mean 'hand'\?.*tool"):
        pera.at(np.zeros(7)).frame_jacobian("hnad", "local")
    with pytest.raises(UnknownNameError, match="unknown frame of reference 'body'.*local_world_aligned"):
        pera.at(np.zeros(7)).frame_jacobian("hand", "body")
    with pytest.raises(UnknownNameError, match="unknown interconnection 'fast'.*canonical, coriolis"):
        pera.at(np.zeros(7)).interconnection("fast")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"friction": "sticky"}, "friction: must be a friction model"),
        ({"friction": StribeckFriction(viscous=[1.0, 2.0, 3.0])}, r"friction.viscous: must have shape \(2,\)"),
        ({"input_matrix": [[1.0, 1.0], [1.0, 1.0]]}, "input_matrix: must be invertible"),
        ({"input_matrix": np.eye(3)}, "input_matrix: must be a scalar, a vector of length 2 or"),
        ({"gravity": [0.0, 0.0]}, "gravity: must have shape"),
    ],
)
def test_bad_systems_are_refused(arguments, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        MechanicalSystem(load_robot("pera_shoulder"), **arguments)


def test_another_system_sees_the_same_motion_with_its_own_model(shoulder):
    x = shoulder.at([0.3, -0.2], [0.7, 0.4])
    x.mass_matrix.flags.writeable = False  # whatever was computed of it
    assert x.seen_by(shoulder) is x
    model = MechanicalSystem(shoulder.robot, friction=None, gravity=(0.0, 0.0, 1.0))
    view, expected = x.seen_by(model), model.at([0.3, -0.2], [0.7, 0.4])
    assert view.system is model
    np.testing.assert_array_equal(view.velocity, [0.7, 0.4])
    np.testing.assert_array_equal(view.gravity, expected.gravity)
    np.testing.assert_array_equal(view.friction_torque, [0.0, 0.0])
    assert np.abs(x.gravity - view.gravity).max() > 1.0


def test_the_view_of_an_arm_with_mimic_joints_has_them_too():
    system = make_system("panda_with_fingers")
    position, velocity = system.robot.home, np.linspace(0.1, 0.8, system.n)
    twin = system.twin()
    view = system.at(position, velocity).seen_by(twin)
    assert type(view) is type(system.at(position))
    np.testing.assert_array_equal(view.coriolis_matrix, twin.at(position, velocity).coriolis_matrix)


def test_an_unknown_frame_of_reference_lists_those_there_are(system):
    x = system.at(system.robot.home)
    frame = system.robot.frame_names[-1]
    methods = (x.frame_jacobian, x.frame_jacobian_rate, x.frame_jacobian_and_rate, x.frame_jacobian_derivative)
    for method in methods:
        for wrong in ("lokal", None, ["local"]):
            with pytest.raises(
                UnknownNameError, match=r"unknown frame of reference .*Known: local, local_world_aligned, world"
            ):
                method(frame, wrong)
