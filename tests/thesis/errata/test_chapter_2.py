"""Errata of chapter 2: the plant, its gripper, the unit-mass coordinates, and passivity."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import GripperSpring, StribeckFriction
from tests.conftest import make_system
from tests.finite_differences import gradient
from tests.thesis.errata.loop import EXACT, along, arm, states

SHOULDER = {"viscous": 4.119, "coulomb": 0.005, "static": 1.905, "stribeck_velocity": 0.167, "smoothing": 0.01}
K1, K2, REST, A_F = 0.21, 0.06, 0.30, 0.001


@pytest.mark.parametrize("name", ["pera_shoulder", "pera_shoulder_elbow"])
def test_e02_friction_takes_energy(name):
    """(2.7), (5.54): with +D in the block of damping the free arm gains energy, and its momentum is another."""
    system = make_system(name)
    for x, _ in states(system, 0):
        rate = along(lambda y, _: y.momentum, x, np.zeros(0), np.zeros(system.n), np.zeros(0))
        conservative = x.coriolis_matrix.T @ x.velocity - x.potential_gradient  # −∂H/∂q
        printed, corrected = (conservative + sign * x.damping * x.velocity for sign in (1.0, -1.0))
        assert np.abs(printed - rate).max() > 0.5 * np.abs(x.friction_torque).max()
        np.testing.assert_allclose(corrected, rate, atol=EXACT * np.abs(rate).max())
        lost = along(lambda y, _: np.array(y.energy), x, np.zeros(0), np.zeros(system.n), np.zeros(0))
        assert lost == pytest.approx(-x.velocity @ (x.damping * x.velocity), rel=1e-6)
        assert lost < 0.0


@pytest.mark.parametrize("name", ["pera_shoulder", "pera_shoulder_elbow"])
def test_e36_the_gradient_of_the_energy_is_not_that_of_the_potential(name):
    """(2.7), (5.54) have ∂V/∂q where (2.2) has ∂H/∂q: M depends on q, so the centrifugal force is missing."""
    system, missing = make_system(name), 0.0
    for x, _ in states(system, 0):
        rate = along(lambda y, _: y.momentum, x, np.zeros(0), np.zeros(system.n), np.zeros(0))
        p = x.momentum

        def energy(q, system=system, p=p):
            M, V = system.at(q).mass_matrix, system.at(q).potential_energy
            return np.array(0.5 * p @ np.linalg.solve(M, p) + V)

        corrected = -gradient(energy, x.position) - x.friction_torque
        printed = -x.potential_gradient - x.friction_torque
        np.testing.assert_allclose(corrected, rate, atol=1e-7 * np.abs(rate).max())
        missing = max(missing, np.abs(printed - rate).max())
    assert missing > 0.1


def test_e03_stribeck_friction_falls_and_never_drives():
    """(2.14), (5.53): exp(+|q̇|/q̇_s) makes dry friction grow without bound; F_v q̇ in d drives where q̇ < 0."""
    F_c, F_s, F_v, v_s, a = (
        SHOULDER[key] for key in ("coulomb", "static", "viscous", "stribeck_velocity", "smoothing")
    )

    def printed(v, sign=1.0, viscous=True):
        return (F_c + (F_s - F_c) * np.exp(sign * abs(v) / v_s)) / np.sqrt(a + v**2) + F_v * (v if viscous else 1.0)

    friction = StribeckFriction(**SHOULDER)
    speeds = np.array([-1.0, -0.3, -0.01, 0.01, 0.3, 1.0])
    corrected = np.array([printed(v, sign=-1.0, viscous=False) for v in speeds])
    np.testing.assert_allclose(corrected, friction.coefficients(speeds), rtol=1e-12)
    np.testing.assert_allclose(corrected, corrected[::-1], rtol=1e-12)  # odd torque
    assert (corrected > 0.0).all()
    dry, printed_dry = ((printed(2.0, sign, viscous=False) - F_v) * 2.0 for sign in (-1.0, 1.0))
    assert dry == pytest.approx(F_c, rel=0.01)  # Coulomb friction at speed
    assert printed_dry > 1e4 * F_s  # 3·10⁵ N·m
    assert printed(-1.0, sign=-1.0) < 0.0  # as printed a joint that closes is driven
    assert printed(-1.0, sign=-1.0) != pytest.approx(printed(1.0, sign=-1.0), rel=0.5)


def test_e04_the_gripper_is_stiff_where_2_16_says():
    """(2.16): k₁ for q below c_g, k₂ above; (2.17) as printed has them the other way round."""

    def stiffness(q, sign):
        return 0.5 * (K1 + K2) + sign * 0.5 * (K1 - K2) * (q - REST) / np.sqrt(A_F + (q - REST) ** 2)

    spring = GripperSpring(closing_stiffness=K1, opening_stiffness=K2, rest_angle=REST, smoothing=A_F)
    for q, exact in ((-2.0, K1), (2.5, K2)):
        assert stiffness(q, -1.0) == pytest.approx(exact, abs=1e-4)
        assert abs(stiffness(q, 1.0) - exact) > 0.1
        assert spring.stiffness(np.array([q]))[0] == pytest.approx(stiffness(q, -1.0), rel=1e-12)


def test_e05_the_potential_of_the_gripper_is_that_of_its_spring():
    """V′ = K_g(q)(q − c_g): (2.18) has ½ and a_f/2 for ¼ and a_f/4, and E4's sign."""

    def potential(q, factor, sign):
        x = q - REST
        root, half = np.sqrt(A_F + x**2), factor * (K1 - K2)
        mixed = x * root + A_F * (np.log(np.sqrt(A_F)) - np.log(x + root))
        return 0.25 * (K1 + K2) * x**2 + sign * half * mixed

    def force(q, sign):
        return (0.5 * (K1 + K2) + sign * 0.5 * (K1 - K2) * (q - REST) / np.sqrt(A_F + (q - REST) ** 2)) * (q - REST)

    spring = GripperSpring(closing_stiffness=K1, opening_stiffness=K2, rest_angle=REST, smoothing=A_F)
    for q in (0.0, 0.2, 0.5, 0.8):
        slope = {
            form: gradient(lambda y, form=form: potential(y[0], *form), np.array([q]), 1e-4)[0]
            for form in ((0.5, 1.0), (0.5, -1.0), (0.25, -1.0))
        }
        assert slope[0.25, -1.0] == pytest.approx(force(q, -1.0), abs=1e-9)
        assert spring.gradient(np.array([q]))[0] == pytest.approx(force(q, -1.0), rel=1e-12)
        assert spring.energy(np.array([q])) == pytest.approx(potential(q, 0.25, -1.0), rel=1e-9)
        for sign in (1.0, -1.0):  # not the force of the printed K_g, nor of the mended one
            assert abs(slope[0.5, sign] - force(q, sign)) > 1e-3


def unit_mass_rate(x, J2):
    """Return p̄̇ of (2.35) with no input."""
    damping = np.linalg.solve(x.factor, x.damping_matrix) @ np.linalg.inv(x.factor).T
    return -np.linalg.solve(x.factor, x.potential_gradient) + (J2 - damping) @ x.transformed_momentum


def test_e06_the_derivative_is_of_the_original_momentum():
    """(2.37): J̄₂ from ∂(T⁻¹p)/∂q at constant p gives the plant; from ∂(T⁻¹p̄)/∂q it does not."""
    worst = 0.0
    for x, _ in states(arm(), 0):

        def derivative_of(vector, x=x):
            def scaled(q):
                return np.linalg.solve(x.system.at(q).factor, vector)

            P = gradient(scaled, x.position).T
            turned = P @ np.linalg.inv(x.factor).T
            return turned - turned.T

        rate = along(lambda y, _: y.transformed_momentum, x, np.zeros(0), np.zeros(3), np.zeros(0))
        size = np.abs(rate).max()
        np.testing.assert_allclose(unit_mass_rate(x, derivative_of(x.momentum)), rate, atol=1e-7 * size)
        printed = unit_mass_rate(x, derivative_of(x.transformed_momentum))
        worst = max(worst, np.abs(printed - rate).max() / size)
    assert worst > 1e-2


def test_e34_the_casimirs_of_3_2_3_exist_only_for_constant_matrices():
    """(2.53): ∂𝒦_ij/∂x_k = ∂𝒦_kj/∂x_i for 𝒦 = [0; (ḠCḠᵀ)⁻¹T⁻¹; …] holds for constant T, fails for T(q)."""

    def curl(system):
        n, worst = system.n, 0.0
        for x, _ in states(system, 0):

            def casimir_gradient(q, system=system, n=n):  # the rows of p̂ of 𝒦, C = 1
                y = system.at(q)
                G = np.linalg.solve(y.factor, y.input_matrix)
                return np.linalg.solve(G @ G.T, np.linalg.inv(y.factor)).ravel()

            # ∂𝒦_(p̂ i)j/∂q_k, to equal ∂𝒦_(q k)j/∂p̂_i = 0
            worst = max(worst, float(np.abs(gradient(casimir_gradient, x.position)).max()))
        return worst

    assert curl(make_system("pera_gripper")) < 1e-9
    assert curl(arm()) > 0.05


def test_e31_passivity_needs_less_than_2_30():
    """A spring that stiffens slowly in a damped coordinate is passive, though (2.30) says that it is not.

    One joint: Φ = (q, p + m q), H̄ = ½p̂²/m + ½k(t)q², k = 1 + t/10. Then H̄̇ = −(k − k̇/2)q² − d(p̂/m)² + ȳū.
    """
    m, d = 0.5, 0.1
    draw = np.random.default_rng(0)
    for _ in range(20):
        q, v, u, t = draw.normal(), draw.normal(), draw.normal(), draw.uniform(0.0, 10.0)

        def stiffness(s):
            return 1.0 + 0.1 * s

        def stored(q, v, t):
            return 0.5 * m * (v + q) ** 2 + 0.5 * stiffness(t) * q**2

        hat, h = m * (v + q), 1e-4
        acceleration = (-stiffness(t) * q - d * hat / m - m * v + u) / m  # of what p̂̇ = −kq − d p̂/m + ū makes
        grown = (stored(q + h * v, v + h * acceleration, t + h) - stored(q - h * v, v - h * acceleration, t - h)) / (
            2.0 * h
        )
        assert grown - (v + q) * u <= 1e-9  # passive
        printed = -0.5 * 0.1 * q**2  # ∂(H + U)ᵀ[…] of (2.30): by (2.25) all but −∂H̄/∂t cancels
        assert printed < 0.0  # so it is called not passive
        corrected = stiffness(t) * q**2 + d * (v + q) ** 2 + printed  # with ∂H̄ᵀR̄∂H̄ beside: S = −R in (2.30)
        assert corrected >= 0.0
        assert grown - (v + q) * u == pytest.approx(-corrected, abs=1e-6)
