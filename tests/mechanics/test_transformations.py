"""Canonical transformations of the thesis pass, others are caught."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError
from phcontrol.mechanics.transformations import check_canonical_transformation
from tests.conftest import make_system
from tests.finite_differences import gradient

ARMS = ["pera_shoulder", "pera_shoulder_elbow"]


def nothing(q, p, t):
    return 0.0


def no_input(q, p, t):
    return np.zeros(q.size)


def unit_mass(system, goal=0.0):
    def transformation(q, p, t):
        return np.concatenate([q - goal, system.at(q).solve_factor(p)])

    return transformation


@pytest.mark.parametrize("arm", ARMS)
def test_the_unit_mass_coordinates_are_canonical(arm):
    """(2.31) with U = β = 0."""
    system = make_system(arm)
    assert check_canonical_transformation(unit_mass(system, 0.3), nothing, no_input, system, samples=5).passed


@pytest.mark.parametrize("arm", ARMS)
def test_energy_shaping_is_canonical_with_its_input_and_only_with_it(arm):
    """U = ½q̃ᵀKq̃ − V needs Gβ = ∂U/∂q."""
    system = make_system(arm)

    def shaped(q, p, t):
        return 5.0 * (q - 0.3) @ (q - 0.3) - system.at(q).potential_energy

    def force(q, p, t):
        return 10.0 * (q - 0.3) - system.at(q).potential_gradient

    phi = unit_mass(system, 0.3)
    assert check_canonical_transformation(phi, shaped, force, system, samples=5).passed
    assert not check_canonical_transformation(phi, shaped, no_input, system, samples=5).passed


class Tracking:
    """Chapter 6 (6.6 to 6.15, errata E22): q − q_d(t), T⁻¹p − Tᵀq̇_d, for a sine."""

    def __init__(self, system, half=0.5):
        self.system, self.half = system, half

    def goal(self, t):
        phase = np.arange(self.system.n)
        return tuple(f(t + phase) * 0.4 for f in (np.sin, np.cos, lambda a: -np.sin(a)))

    def phi(self, q, p, t):
        x, (qd, vd, _) = self.system.at(q), self.goal(t)
        return np.concatenate([q - qd, x.solve_factor(p) - vd @ x.factor])

    def change(self, q, p, t):
        x, (qd, vd, _) = self.system.at(q), self.goal(t)
        kinetic = self.half * vd @ x.mass_matrix @ vd
        return -p @ vd + kinetic - x.potential_energy + 5.0 * (q - qd) @ (q - qd)

    def input(self, q, p, t):
        """Gβ = ∂U/∂q − D q̇_d + T(P_d q̇_d − Tᵀq̈_d), ∂U/∂q and P_d analytically."""
        system, (qd, vd, ad) = self.system, self.goal(t)
        x = system.at(q, np.linalg.solve(system.at(q).mass_matrix, p))
        slope = self.half * np.einsum("i,kij,j->k", vd, x.mass_matrix_derivative, vd)
        slope = slope - x.potential_gradient + 10.0 * (q - qd)
        P = x.momentum_derivative - np.einsum("kij,i->jk", x.factor_derivative, vd)
        return slope - x.damping_matrix @ vd + x.factor @ (P @ vd - x.factor.T @ ad)


@pytest.mark.parametrize("arm", ARMS)
def test_the_tracking_transformation_of_chapter_6_is_canonical(arm):
    study = Tracking(make_system(arm))
    check = check_canonical_transformation(study.phi, study.change, study.input, study.system, samples=5)
    assert check.passed, check


def test_moving_coordinates_without_their_energy_are_caught():
    """Φ with q_d(t), but U = β = 0: not canonical."""
    study = Tracking(make_system("pera_shoulder"))
    assert not check_canonical_transformation(study.phi, nothing, no_input, study.system, samples=5).passed


def test_the_missing_half_of_errata_e22_is_caught():
    """∂(q̇_dᵀMq̇_d)/∂q in β without the half, as (6.9) and (6.14) have it."""
    study, printed = (
        Tracking(make_system("pera_shoulder_elbow")),
        Tracking(make_system("pera_shoulder_elbow"), half=1.0),
    )
    assert not check_canonical_transformation(study.phi, study.change, printed.input, study.system, samples=5).passed


def test_momentum_derivative_used_above_is_right(rng):
    system = make_system("pera_shoulder_elbow")
    study, t = Tracking(system), 0.7
    q, p = system.robot.random_position(rng), rng.normal(size=3)
    _, vd, _ = study.goal(t)
    x = system.at(q, np.linalg.solve(system.at(q).mass_matrix, p))
    expected = gradient(lambda y: study.phi(y, p, t)[3:], q).T
    actual = x.momentum_derivative - np.einsum("kij,i->jk", x.factor_derivative, vd)
    np.testing.assert_allclose(actual, expected, atol=1e-7)


def test_added_structure_must_be_skew_and_symmetric():
    system = make_system("pera_shoulder")
    phi = unit_mass(system)
    with pytest.raises(InvalidArgumentError, match="interconnection_change: must be skew-symmetric"):
        check_canonical_transformation(phi, nothing, no_input, system, interconnection_change=lambda q, p, t: np.eye(4))
    lopsided = np.triu(np.ones((4, 4)))
    with pytest.raises(InvalidArgumentError, match="dissipation_change: must be symmetric"):
        check_canonical_transformation(phi, nothing, no_input, system, dissipation_change=lambda q, p, t: lopsided)


def test_negative_dissipation_is_caught():
    """S = −εI cancelled by β keeps (2.25), but R + S is not positive semidefinite."""
    system = make_system("pera_gripper")
    S = np.diag([0.0, -5.0])

    def force(q, p, t):
        return S[1:, 1:] @ (p / 0.5)

    check = check_canonical_transformation(
        unit_mass(system), nothing, force, system, dissipation_change=lambda q, p, t: S, samples=5
    )
    assert check.residual < 1e-6
    assert not check.passed


@pytest.mark.parametrize(
    ("phi", "complaint"),
    [
        (lambda q, p, t: np.zeros(4), "does not change"),
        (lambda q, p, t: np.concatenate([q, q]), "is degenerate"),
        (lambda q, p, t: np.concatenate([p, np.sum(p) * np.ones(2)]), "is degenerate"),
        (lambda q, p, t: q, "must give 4 coordinates"),
    ],
)
def test_a_transformation_that_forgets_coordinates_is_refused(phi, complaint):
    """Φ = 0 solves (2.25) for any U and β, and says nothing."""
    with pytest.raises(InvalidArgumentError, match=f"transformation: .*{complaint}"):
        check_canonical_transformation(phi, nothing, no_input, make_system("pera_shoulder"), samples=2)
