"""Theorem 2.2.2: what a transformation makes of an arm, against closed forms and true motions."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import MechanicalSystem, StribeckFriction
from phcontrol.mechanics.transformations import check_transformed_passivity
from phcontrol.mechanics.transformed_system import transformed_system
from tests.conftest import make_system
from tests.finite_differences import derivative
from tests.mechanics.test_transformations import Tracking, no_input, nothing, unit_mass

GOAL = 0.3


def geared():
    """Return three joints with an input matrix that is not 1."""
    mixing = [[1.0, 0.2, 0.0], [0.0, 0.8, 0.3], [-0.1, 0.0, 1.2]]
    arm = make_system("pera_shoulder_elbow")
    return MechanicalSystem(arm.robot, friction=StribeckFriction(viscous=[0.5, 0.4, 0.3]), input_matrix=mixing)


def shaped(system):
    def change(q, p, t):
        return 5.0 * (q - GOAL) @ (q - GOAL) - system.at(q).potential_energy

    return change


def test_the_unit_mass_coordinates_have_the_structure_of_2_35(rng):
    """J̄₂ of (2.37), D̄ of (2.39) and Ḡ of (2.40) beside, α = β = 0."""
    system = geared()
    q, v = system.robot.random_position(rng), rng.normal(size=3)
    x = system.at(q, v)
    found = transformed_system(unit_mass(system), nothing, system, q, x.momentum, input_change=no_input)
    inverse = np.linalg.inv(x.factor)
    np.testing.assert_allclose(
        found.interconnection,
        np.block([[np.zeros((3, 3)), inverse.T], [-inverse, x.canonical_interconnection]]),
        atol=1e-7,
    )
    np.testing.assert_allclose(found.dissipation[3:, 3:], inverse @ x.damping_matrix @ inverse.T, atol=1e-9)
    np.testing.assert_allclose(found.input_matrix, np.vstack([np.zeros((3, 3)), inverse @ x.input_matrix]), atol=1e-9)
    np.testing.assert_allclose(found.output_change, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.storage_gradient, np.r_[x.potential_gradient, x.transformed_momentum], atol=1e-8)


def test_beta_and_alpha_follow_from_the_equation(rng):
    """Energy shaping: Gβ = K q̃ − ∂V/∂q; chapter 6: α = −Gᵀq̇_d, Gβ as (6.14) corrected, also in time."""
    system = geared()
    q, v = system.robot.random_position(rng), rng.normal(size=3)
    x = system.at(q, v)
    found = transformed_system(unit_mass(system), shaped(system), system, q, x.momentum)
    np.testing.assert_allclose(x.input_matrix @ found.input_change, 10.0 * (q - GOAL) - x.potential_gradient, atol=1e-7)
    plain = MechanicalSystem(system.robot, friction=system.friction)
    study, t = Tracking(plain), 0.7
    moving = transformed_system(study.phi, study.change, plain, q, x.momentum, t)
    np.testing.assert_allclose(moving.input_change, study.input(q, x.momentum, t), atol=1e-6)
    np.testing.assert_allclose(moving.output_change, -study.goal(t)[1], atol=1e-8)
    assert moving.residual < 1e-7


@pytest.mark.parametrize("time", [0.0, 1.3])
def test_what_is_returned_moves_as_the_arm_does(rng, time):
    """x̄̇ = (J̄ − R̄)∂H̄/∂x̄ + ḡ(u + β) and H̄̇ = growth + ȳᵀū, against finite differences along the true motion."""
    system = MechanicalSystem(make_system("pera_shoulder_elbow").robot, friction=StribeckFriction(viscous=0.4))
    study = Tracking(system)
    q, v, torque = system.robot.random_position(rng), rng.normal(size=3), rng.normal(size=3)
    x = system.at(q, v)
    found = transformed_system(study.phi, study.change, system, q, x.momentum, time)
    acceleration = x.acceleration(torque)

    def along(h):
        there = system.at(q + h * v, v + h * acceleration)
        energy = there.energy + study.change(there.position, there.momentum, time + h)
        return np.r_[study.phi(there.position, there.momentum, time + h), energy]

    rate = derivative(along)
    pushed = torque + found.input_change
    promised = (found.interconnection - found.dissipation) @ found.storage_gradient + found.input_matrix @ pushed
    np.testing.assert_allclose(promised, rate[:6], atol=1e-6)
    supplied = (x.output + found.output_change) @ pushed
    assert found.growth + supplied == pytest.approx(rate[6], abs=1e-6)


@pytest.mark.parametrize("arm", ["pera_shoulder", "pera_shoulder_elbow"])
def test_energy_shaping_is_passive_and_without_its_input_it_is_not(arm):
    system = make_system(arm)
    phi, change = unit_mass(system, GOAL), shaped(system)
    assert check_transformed_passivity(phi, change, system, samples=5).passed
    found = check_transformed_passivity(phi, change, system, input_change=no_input, samples=5)
    assert not found.passed
    assert found.growth > 0.1


def test_the_moving_goal_of_chapter_6_is_passive():
    study = Tracking(make_system("pera_shoulder"))
    found = check_transformed_passivity(study.phi, study.change, study.system, input_change=study.input, samples=5)
    assert found.passed
    assert found.residual < 1e-6
    free = Tracking(MechanicalSystem(study.system.robot, friction=None))  # where no loss hides what β puts in
    printed = Tracking(free.system, half=1.0)  # E22
    assert check_transformed_passivity(free.phi, free.change, free.system, input_change=free.input).passed
    wrong = check_transformed_passivity(free.phi, free.change, free.system, input_change=printed.input)
    assert not wrong.passed
    assert wrong.growth > 1e-4


def test_an_energy_without_a_floor_is_not_passed():
    """The arm itself, U = β = 0, on a base 0.85 m high has H > 0; counted from elsewhere it has not."""
    system = make_system("pera_shoulder")
    assert check_transformed_passivity(unit_mass(system), nothing, system, samples=20).passed
    lowered = check_transformed_passivity(unit_mass(system), lambda q, p, t: -30.0, system, samples=20)
    assert lowered.growth <= 1e-9
    assert not lowered.passed


class Stiffening:
    """One joint, Φ = (q, p + m q), H̄ = ½p̂²/m + ½k(t)q², k = 1 + rate·t: E31's counterexample as (Φ, U, K, S)."""

    def __init__(self, rate):
        self.system = MechanicalSystem(make_system("pera_gripper").robot, friction=StribeckFriction(viscous=0.1))
        self.m, self.rate = self.system.at([0.3]).mass_matrix[0, 0], rate
        self.T = np.sqrt(self.m)

    def phi(self, q, p, t):
        return np.array([q[0], p[0] + self.m * q[0]])

    def k(self, t):
        return 1.0 + self.rate * t

    def change(self, q, p, t):
        hat = p[0] + self.m * q[0]
        return 0.5 * hat**2 / self.m + 0.5 * self.k(t) * q[0] ** 2 - 0.5 * p[0] ** 2 / self.m - self.potential(q)

    def potential(self, q):
        return self.system.at(q).potential_energy

    def structure(self, t):
        """Return K and S: those that make J̄ = [[0, 1], [−1, 0]], R̄ = diag(1/k, d)."""
        inverse = np.linalg.inv(np.array([[1.0, 0.0], [self.m, 1.0]]))
        J = np.array([[0.0, 1.0], [-1.0, 0.0]])
        desired = inverse @ (J - np.diag([1.0 / self.k(t), 0.1])) @ inverse.T
        added = desired - (J - np.diag([0.0, 0.1]))
        return 0.5 * (added - added.T), -0.5 * (added + added.T)

    def check(self):
        return check_transformed_passivity(
            self.phi,
            self.change,
            self.system,
            interconnection_change=lambda q, p, t: self.structure(t)[0],
            dissipation_change=lambda q, p, t: self.structure(t)[1],
        )


def test_passivity_is_told_exactly_where_2_30_is_sufficient_only():
    """k̇ = 0.1: passive, as ½k̇ ≤ k, though (2.30) is negative. k̇ = 3: not passive. k̇ = −0.05: both say passive."""
    slow, fast, falling = (Stiffening(rate).check() for rate in (0.1, 3.0, -0.05))
    assert slow.residual < 1e-6
    assert slow.passed
    assert slow.printed_condition < -1e-4
    assert not fast.passed
    assert falling.passed
    assert falling.printed_condition > -1e-9


def test_the_feedback_of_the_theorem_brings_the_arm_to_rest():
    """u = −β − 𝒞(y + α), simulated with nothing but the forward dynamics."""
    system = geared()
    phi, change = unit_mass(system, GOAL), shaped(system)
    q, v, gain, h = np.array([1.0, -0.5, 0.4]), np.zeros(3), 4.0 * np.eye(3), 0.02

    def acceleration(q, v):
        x = system.at(q, v)
        found = transformed_system(phi, change, system, q, x.momentum)
        return x.acceleration(found.feedback(gain, x.output))

    for _ in range(600):
        middle = v + 0.5 * h * acceleration(q, v)
        q, v = q + h * middle, v + h * acceleration(q + 0.5 * h * v, middle)
    np.testing.assert_allclose(q, GOAL, atol=1e-3)
