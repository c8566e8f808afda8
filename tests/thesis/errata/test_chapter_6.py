"""Errata of chapter 6, tracking, and of appendix A."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import MechanicalSystem, StribeckFriction, check_canonical_transformation, load_robot
from phcontrol.thesis import appendix_a
from tests.conftest import make_system
from tests.finite_differences import derivative, gradient
from tests.thesis.errata.loop import FORCE, along, arm, mismatch, states
from tests.thesis.errata.test_chapter_3 import WRONG, C, bar

K_T = np.diag([5.0, 4.0, 3.0])
NOW = 0.7


def goal(t):
    """Return q_d, q̇_d, q̈_d of a sine."""
    phase = t + np.arange(3)
    return 0.4 * np.sin(phase), 0.4 * np.cos(phase), -0.4 * np.sin(phase)


def energy_change(system, q, p, t, potential=True):
    """U of (6.6), corrected with −V + ½q̃ᵀK_t q̃ (E22)."""
    qd, vd, _ = goal(t)
    x = system.at(q)
    change = -p @ vd + 0.5 * vd @ x.mass_matrix @ vd
    return change + (0.5 * (q - qd) @ K_T @ (q - qd) - x.potential_energy if potential else 0.0)


def coordinates_change(system, q, p, t):
    qd, vd, _ = goal(t)
    x = system.at(q)
    return np.concatenate([q - qd, np.linalg.solve(x.factor, p) - x.factor.T @ vd])


def input_force(x, t, half=0.5, potential=True):
    """Gβ of (6.14); printed with half = 1 and without the potential."""
    qd, vd, ad = goal(t)
    slope = half * gradient(lambda q: vd @ x.system.at(q).mass_matrix @ vd, x.position)
    if potential:
        slope = slope - x.potential_gradient + K_T @ (x.position - qd)
    p, q = x.momentum, x.position
    P = gradient(lambda y: coordinates_change(x.system, y, p, t)[3:], q).T
    return slope - x.damping * vd + x.factor @ (P @ vd - x.factor.T @ ad)


def test_e22_the_transformation_of_chapter_6():
    """(6.6), (6.9), (6.14), (6.15): ∂(q̇_dᵀMq̇_d)/∂q for half of it; no potential in U; +K_t q̃ in u."""
    system = MechanicalSystem(arm().robot, friction=arm().friction)

    def passed(half, in_energy, in_input):
        def change_of_input(q, p, t):
            x = system.at(q, np.linalg.solve(system.at(q).mass_matrix, p))
            return input_force(x, t, half, in_input)

        return check_canonical_transformation(
            lambda q, p, t: coordinates_change(system, q, p, t),
            lambda q, p, t: energy_change(system, q, p, t, in_energy),
            change_of_input,
            system,
            samples=3,
        ).passed

    assert passed(0.5, True, True)
    assert not passed(1.0, True, True)
    assert not passed(0.5, True, False)
    # without the potential in U the sum (6.7) is ½p̄ᵀp̄ + V, which has no minimum at q_d: nothing holds the arm there
    x = system.at(goal(NOW)[0])
    for potential, holds in ((True, True), (False, False)):

        def total(q, potential=potential):
            return np.array(system.at(q).potential_energy + energy_change(system, q, x.momentum * 0.0, NOW, potential))

        def shaped(q, total=total):
            vd = goal(NOW)[1]
            return total(q) - 0.5 * vd @ system.at(q).mass_matrix @ vd

        slope = np.abs(gradient(shaped, x.position)).max()
        assert slope < 1e-8 if holds else slope > 0.1

    # +K_t q̃ in u drives away: Ḣ of ½|p̂|² + ½q̃ᵀK_t q̃ along the true motion
    def growth(sign):
        worst = -np.inf
        for x, _ in states(system, 0):
            torque = tracking_force(x, sign)

            def stored(y, s):
                qd, vd, _ = goal(NOW + s[0])
                hatted = y.factor.T @ (y.velocity - vd)
                return np.array(0.5 * hatted @ hatted + 0.5 * (y.position - qd) @ K_T @ (y.position - qd))

            worst = max(worst, float(along(stored, x, np.zeros(1), torque, np.ones(1))))
        return worst

    assert growth(-1.0) <= 0.0
    assert growth(1.0) > 0.1


def tracking_force(x, sign=-1.0, t=NOW):
    """Return Gu = ∂V/∂q + sign K_t q̃ − Gβ(kinetic part) − C(q̇ − q̇_d): (6.15) with −f_e for −f."""
    qd, vd, _ = goal(t)
    kinetic = input_force(x, t, 0.5, potential=False)
    return x.potential_gradient + sign * K_T @ (x.position - qd) - kinetic - C @ (x.velocity - vd)


def test_e26_friction_is_compensated_once():
    """(6.15) with (6.1), (6.14): −f holds +D q̇ beside −β with +D q̇_d; so on the trajectory u is D q̇ too much."""
    system = MechanicalSystem(arm().robot, friction=arm().friction)
    qd, vd, ad = goal(NOW)
    x = system.at(qd, vd)
    corrected = tracking_force(x) - FORCE
    np.testing.assert_allclose(x.acceleration(corrected, FORCE), ad, atol=1e-7)
    total = along(lambda y, _: y.momentum, x, np.zeros(0), np.zeros(3), np.zeros(0), FORCE)  # f of (6.1)
    printed = -total + K_T @ (x.position - qd) - input_force(x, NOW, 0.5, potential=False)
    assert np.abs(x.acceleration(printed, FORCE) - ad).max() > 0.1
    centrifugal = x.coriolis_matrix.T @ vd
    np.testing.assert_allclose(printed - corrected, x.damping * vd - centrifugal, atol=1e-7)
    # F_v A ω/K_t on the shoulder at 1/30 Hz: the ±13 mrad of figure 6.2
    error = steady_error(printed=True)
    assert error == pytest.approx(4.119 * (2.0 * np.pi / 9.0) * (2.0 * np.pi / 30.0) / 45.0, rel=0.02)
    assert error == pytest.approx(0.013, rel=0.05)
    assert steady_error(printed=False) < 1e-4


def steady_error(printed):
    """Return the largest error of joint 1 in the second of two periods of (6.16), with viscous friction."""
    system = MechanicalSystem(load_robot("pera_shoulder"), friction=StribeckFriction(viscous=[4.119, 4.973]))
    amplitude, w = 2.0 * np.pi / 9.0, 2.0 * np.pi / 30.0
    q, v, h, worst = np.zeros(2), np.zeros(2), 0.01, 0.0

    def rate(t, q, v):
        x = system.at(q, v)
        qd = np.array([amplitude * (1.0 - np.cos(w * t)), 0.0])
        vd, ad = np.array([amplitude * w * np.sin(w * t), 0.0]), np.array([amplitude * w**2 * np.cos(w * t), 0.0])
        u = x.potential_gradient + x.mass_matrix @ ad + x.coriolis_matrix @ vd + x.damping * vd
        u = u - 45.0 * (q - qd) - 10.0 * (v - vd)
        return x.acceleration(u + (x.damping * v if printed else 0.0)), qd

    for k in range(6000):  # the midpoint rule
        t = h * k
        a, qd = rate(t, q, v)
        worst = max(worst, abs(q[0] - qd[0])) if k > 3000 else 0.0
        middle = v + 0.5 * h * a
        q, v = q + h * middle, v + h * rate(t + 0.5 * h, q + 0.5 * h * v, middle)[0]
    return worst


def test_e35_the_time_column_of_6_8():
    """(6.8): ∂q̄/∂t = −q̇_d; printed q̇ − q̇_d. And ∂p̄/∂t = −Tᵀq̈_d, T does not depend on t."""
    system = arm()
    for x, _ in states(system, 0):
        column = derivative(lambda h, x=x: coordinates_change(system, x.position, x.momentum, NOW + h))
        _, vd, ad = goal(NOW)
        np.testing.assert_allclose(np.concatenate([-vd, -x.factor.T @ ad]), column, atol=1e-9)
        assert np.abs(x.velocity - vd - column[:3]).max() > 0.1


def test_e22_the_corrected_law_makes_the_error_system():
    """The matching of (6.15) as corrected, with an interconnection of its own (J̄₂ of ∂p̄/∂q)."""
    system = MechanicalSystem(arm().robot, friction=arm().friction)

    def coordinates(x, s):
        qd, vd, _ = goal(NOW + s[0])
        return np.concatenate([x.position - qd, x.factor.T @ (x.velocity - vd)])

    def promise(x, s):
        qd, vd, _ = goal(NOW + s[0])
        inverse, _, D, _ = bar(x)
        P = gradient(lambda y: coordinates_change(x.system, y, x.momentum, NOW + s[0])[3:], x.position).T
        J2 = P @ inverse.T - inverse @ P.T
        hatted = x.factor.T @ (x.velocity - vd)
        rest = -inverse @ K_T @ (x.position - qd) + (J2 - D - inverse @ C @ inverse.T) @ hatted
        return np.concatenate([inverse.T @ hatted, rest])

    def law(sign):
        return lambda x, s: (tracking_force(x, sign, NOW + s[0]), np.ones(1))

    assert mismatch(law(-1.0), coordinates, promise, 1, system=system) < 1e-6
    assert mismatch(law(1.0), coordinates, promise, 1, system=system) > WRONG


def test_e01_the_first_entry_of_appendix_a():
    """m̄₁₁: +d²m₇c₂²c₄² for −, and c₃²c₄² of m₇ that cancels itself, of m₆ that is missing."""
    pera, worst = make_system("pera"), 0.0
    d, m6, m7 = appendix_a.D5, appendix_a.M[6], appendix_a.M[7]
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, size=(10, 7)):
        c2, c3, c4 = np.cos(q[1:4])
        corrected = appendix_a.mass_matrix(q)[0, 0]
        symmetric = d**2 * (m6 + m7) * (c2**2 * c3**2 - c2**2 * c4**2 + c3**2 * c4**2 - c2**2 * c3**2 * c4**2)
        as_printed = d**2 * (
            m6 * (c2**2 * c3**2 - c2**2 * c4**2 - c2**2 * c3**2 * c4**2)
            + m7 * (c2**2 * c3**2 + c2**2 * c4**2 - c3**2 * c4**2 + c3**2 * c4**2 - c2**2 * c3**2 * c4**2)
        )
        M = pera.at(q).mass_matrix[0, 0]
        assert corrected == pytest.approx(M, abs=1e-12)
        worst = max(worst, abs(corrected - symmetric + as_printed - M))
    assert worst > 1e-3
