"""Errata of chapter 3: force feedback, its gain and equilibrium, integral action, total forces."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from phcontrol import MechanicalSystem, simulate
from phcontrol.controllers.force_feedback import ForceFeedback
from tests.conftest import make_system
from tests.thesis.errata.loop import EXACT, FORCE, GOAL, along, arm, mismatch, states

A = np.array([[0.5, 0.1, 0.0], [0.0, 0.7, 0.0], [0.2, 0.0, 0.6]])
K_Z = np.diag([2.0, 1.0, 3.0])
K_P = np.diag([15.0, 10.0, 8.0])
C = np.diag([4.0, 3.0, 5.0])
Y = A @ K_Z
WRONG = 0.02  # of the largest rate: the least that a printed form is off


def bar(x):
    """Return T⁻¹, J̄₂, D̄, Ḡ, B̄ = T⁻¹ of a state."""
    inverse = np.linalg.inv(x.factor)
    return inverse, x.canonical_interconnection, inverse @ x.damping_matrix @ inverse.T, inverse @ x.input_matrix


def hat(x, z):
    return x.factor.T @ x.velocity - A @ z


def law(x, z, force=None, *, rate_fed=True, pulled_back=True, shaped=True, measured=False):
    """(3.4) with (3.11), ż (3.2): as corrected, or with one thing as printed.

    Args:
        x: the arm. z: the law's state. force: f_e, for the measured variant.
        rate_fed: A ż in v, else A z (E8). pulled_back: T⁻¹ before the forces inside Ḡ⁻¹, else not (E9).
        shaped: ż from −T⁻¹K_p q̃, else from −T⁻¹∂V/∂q (E10). measured: f_e in ż.
    """
    inverse, J2, D, G = bar(x)
    spring = K_P @ (x.position - GOAL)
    rate = Y.T @ (-inverse @ (spring if shaped else x.potential_gradient) + (J2 - D) @ x.factor.T @ x.velocity)
    if measured:
        rate = rate + Y.T @ inverse @ force
    forces = x.potential_gradient - spring
    v = np.linalg.solve(G, A @ (rate if rate_fed else z) + (inverse @ forces if pulled_back else forces))
    return v - C @ G.T @ hat(x, z), rate


def closed_loop(x, z, force=None, measured=False):
    """(3.12), with f_e: the rates of q, p̂, z."""
    J_R, gradient = matrices(x), np.concatenate([K_P @ (x.position - GOAL), hat(x, z), np.linalg.solve(K_Z, z)])
    rate = J_R @ gradient
    if force is not None:
        pushed = np.linalg.inv(x.factor) @ force
        rate[3:6] += pushed
        rate[6:] += Y.T @ pushed if measured else 0.0
    return rate


def matrices(x, damping=C):
    inverse, J2, D, G = bar(x)
    zero = np.zeros((3, 3))
    return np.block(
        [
            [zero, inverse.T, inverse.T @ Y],
            [-inverse, J2 - D - G @ damping @ G.T, (J2 - D) @ Y],
            [-Y.T @ inverse, -Y.T @ (J2.T + D), -Y.T @ (J2.T + D) @ Y],
        ]
    )


def coordinates(x, z):
    return np.concatenate([x.position - GOAL, hat(x, z), z])


def off(**form):
    return mismatch(partial(law, **form), coordinates, closed_loop, 3)


def test_the_corrected_law_makes_the_closed_loop_of_theorem_3_2_1():
    assert off() < EXACT


def test_e08_the_rate_of_z_is_fed_back():
    """(3.4), (3.16): A z in the input in place of A ż."""
    assert off() < EXACT
    assert off(rate_fed=False) > WRONG


def test_e09_forces_are_pulled_back_before_the_transformed_input_is_inverted():
    """(3.11), (3.16), (3.42), (3.51): Ḡ⁻¹(∂V/∂q − K_p q̃), where Ḡ⁻¹T⁻¹(…) = G⁻¹(…) is meant."""
    assert off() < EXACT
    assert off(pulled_back=False) > WRONG


def test_e10_z_integrates_the_shaped_forces():
    """(3.2) with (3.12): with the forces before shaping the row of z is another."""
    assert off() < EXACT
    assert off(shaped=False) > WRONG


def test_e11_dissipation_adds_up():
    """(3.15): Ḣ_d has +D̄Y off the diagonal; as printed, with −D̄Y, it is another."""
    worst = 0.0
    for x, z in states(arm(), 3):

        def stored(y, w):
            e = y.position - GOAL
            return np.array(0.5 * (hat(y, w) @ hat(y, w) + e @ K_P @ e + w @ np.linalg.solve(K_Z, w)))

        rate = along(stored, x, z, *law(x, z))
        _, _, D, G = bar(x)
        gradient = np.concatenate([hat(x, z), np.linalg.solve(K_Z, z)])
        printed, corrected = (
            -gradient @ np.block([[D + G @ C @ G.T, s * D @ Y], [s * Y.T @ D, Y.T @ D @ Y]]) @ gradient
            for s in (-1.0, 1.0)
        )
        assert corrected == pytest.approx(rate, rel=1e-6)
        worst = max(worst, abs(printed - rate) / abs(rate))
    assert worst > WRONG


def rest_rate(position, z, measured):
    """Return the rates of p̂ and z where the arm stands still, under FORCE."""
    x = arm().at(position)
    torque, rate = law(x, z, FORCE, measured=measured)
    return np.concatenate([x.acceleration(torque, FORCE), rate])


def test_e12_only_the_measured_force_shifts_the_rest():
    """(3.36) to (3.40): the modeled law rests at q_d; at the printed q_d + K_p⁻¹f_e no z at all brings it to rest."""
    shift = np.linalg.solve(K_P, FORCE)
    inverse, _, _, G = bar(arm().at(GOAL))
    z = -np.linalg.solve(A, np.linalg.solve(G @ C @ G.T, inverse @ FORCE))
    assert np.abs(rest_rate(GOAL, z, measured=False)).max() < 1e-10
    drawn = np.random.default_rng(0).normal(size=(20, 3))
    assert min(np.abs(rest_rate(GOAL + shift, z, False)[3:]).max() for z in drawn) > 0.5  # ż = −YᵀT⁻¹f_e, for all z
    assert np.abs(rest_rate(GOAL + shift, np.zeros(3), measured=True)).max() < 1e-10
    assert np.abs(rest_rate(GOAL, z, measured=True)).max() > 0.5
    # (3.36) of the measured law: f_e acts in the rate of z as well, and 𝒦 is constant, so that q is the Casimir
    for x, _ in states(arm(), 0):
        pushed = np.linalg.inv(x.factor)
        K = -np.linalg.solve(matrices(x), np.vstack([np.zeros((3, 3)), pushed, Y.T @ pushed]))
        np.testing.assert_allclose(K, np.vstack([np.eye(3), np.zeros((6, 3))]), atol=1e-9)


def test_e29_the_sign_of_the_gradient_of_the_casimirs():
    """(3.35) to (3.37): 𝒦 = −(J − R)⁻¹g is [0; +(ḠCḠᵀ)⁻¹B̄; −Y⁻¹(ḠCḠᵀ)⁻¹B̄]; printed with the other signs."""
    for x, _ in states(arm(), 0):
        inverse, _, _, G = bar(x)
        K = -np.linalg.solve(matrices(x), np.vstack([np.zeros((3, 3)), inverse, np.zeros((3, 3))]))
        middle = np.linalg.solve(G @ C @ G.T, inverse)
        corrected = np.vstack([np.zeros((3, 3)), middle, -np.linalg.solve(Y, middle)])
        np.testing.assert_allclose(K, corrected, atol=1e-9 * np.abs(K).max())
        assert np.abs(K + corrected).max() > np.abs(K).max()


def test_e30_the_energy_of_z_for_a_constant_mass():
    """(3.10): zᵀK_z z; the row of q of (3.5), q̇ = M⁻¹p̂ + Y∂H/∂z with Y = M⁻¹AK_z, needs zᵀK_z⁻¹z."""
    M = arm().at(GOAL).mass_matrix  # a constant one
    draw = np.random.default_rng(1)
    for _ in range(5):
        velocity, z = draw.normal(size=3), draw.normal(size=3)
        momentum = M @ velocity - A @ z  # p̂
        printed, corrected = (
            np.linalg.solve(M, momentum) + np.linalg.solve(M, A @ K_Z) @ slope
            for slope in (K_Z @ z, np.linalg.solve(K_Z, z))
        )
        np.testing.assert_allclose(corrected, velocity, atol=1e-12)
        assert np.abs(printed - velocity).max() > 0.1


def gammas(x, C, gamma, friction=-1.0, last=0.25):
    """Return P_HJi of (3.34) with G = B = 1 as printed: (3.17) to (3.19)."""
    inverse, one = np.linalg.inv(x.factor), np.eye(3)
    first = friction * x.damping_matrix - C + 0.5 * one + last / gamma**2 * one
    second = A.T @ inverse @ (-C + 0.5 * one + 0.5 / gamma**2 * one) @ inverse.T @ A
    third = 0.5 / gamma**2 * A.T @ inverse
    return np.block([[first, -third.T], [-third, second]])


def test_e24_the_conditions_for_the_gain():
    """(3.17) to (3.20): the form P_HJi is not the Hamilton–Jacobi inequality; they allow too small a γ."""
    plain = MechanicalSystem(arm().robot, friction=arm().friction)
    gamma, worst = 0.5, 0.0
    for x, z in states(plain, 3):
        inverse = np.linalg.inv(x.factor)
        D, output = x.damping_matrix, x.velocity - inverse.T @ A @ z  # ŷ
        # (2.44) with W = H_d, its rate by finite differences along the true motion without f_e

        def stored(y, w):
            e = y.position - GOAL
            return np.array(0.5 * (hat(y, w) @ hat(y, w) + e @ K_P @ e + w @ np.linalg.solve(K_Z, w)))

        rate = float(along(stored, x, z, *law(x, z)))
        inequality = rate + 0.5 / gamma**2 * output @ output + 0.5 * output @ output
        mixed = np.concatenate([x.velocity, z])
        printed = mixed @ gammas(x, C, gamma) @ mixed
        corrected = -x.velocity @ D @ x.velocity - output @ (C - 0.5 * (1.0 + gamma**-2) * np.eye(3)) @ output
        assert corrected == pytest.approx(inequality, rel=1e-6)
        worst = max(worst, abs(printed - inequality) / abs(inequality))
    assert worst > 0.1
    # one joint without friction and A = 0: C = 2 makes (3.17) to (3.20) hold with γ = 1/√6, while the gain is ½
    printed_gain = 1.0 / np.sqrt(4.0 * 2.0 - 2.0)
    norm = max(abs(1j * w / (15.0 - 0.3 * w**2 + 2.0j * w)) for w in np.geomspace(0.1, 100.0, 20001))
    assert -2.0 + 0.5 + 0.25 / printed_gain**2 <= 1e-12
    assert norm == pytest.approx(0.5, rel=1e-6)
    assert printed_gain < 0.85 * norm
    assert norm <= 1.0 / 2.0 + 1e-9 <= 1.0 / np.sqrt(2.0 * 2.0 - 1.0)  # 1/λ_min(C), and with W = H_d


def test_e07_the_total_force_is_transformed_with_the_rate_of_T():
    """Remark 3.1.1, (3.53), (3.54): p̄̇ is T⁻¹f − T⁻¹Ṫp̄, and not T⁻¹f."""
    worst = 0.0
    for x, _ in states(arm(), 0):
        rate = along(lambda y, _: y.transformed_momentum, x, np.zeros(0), np.zeros(3), np.zeros(0), FORCE)
        f = along(lambda y, _: y.momentum, x, np.zeros(0), np.zeros(3), np.zeros(0), FORCE)  # what sensors show
        factor_rate = along(lambda y, _: y.factor, x, np.zeros(0), np.zeros(3), np.zeros(0), FORCE)
        corrected = np.linalg.solve(x.factor, f - factor_rate @ x.transformed_momentum)
        np.testing.assert_allclose(corrected, rate, atol=1e-8 * np.abs(rate).max())
        worst = max(worst, np.abs(np.linalg.solve(x.factor, f) - rate).max() / np.abs(rate).max())
    assert worst > 0.01


K_I = np.diag([1.0, 0.5, 0.8])


def integral_hat(x, z, transposed=True):
    """p̃ of (3.43); corrected with Tᵀ."""
    error = K_I @ (x.position - GOAL)
    return hat(x, z) + (x.factor.T @ error if transposed else error)


def integral_law(x, state, force, *, sign=1.0, transposed=True):
    """(3.41), (3.42): as corrected, or with ξ̇ or p̃ as printed."""
    z, xi = state[:3], state[3:]
    inverse, J2, D, G = bar(x)
    spring = K_P @ (x.position - GOAL)
    momentum = integral_hat(x, z, transposed)
    rate = Y.T @ (-inverse @ spring + (J2 - D) @ (momentum + A @ z))
    factor_rate = x.factor_rate
    added = factor_rate.T @ K_I @ (x.position - GOAL) + x.factor.T @ K_I @ x.velocity
    if not transposed:
        added = K_I @ x.velocity
    flow = -inverse @ spring + (J2 - D) @ (momentum + A @ z) - G @ C @ G.T @ momentum - inverse @ xi
    if not transposed:  # (3.42) as printed has nothing of (J̄₂ − D̄)K_i q̃
        flow = -inverse @ spring + (J2 - D) @ x.factor.T @ x.velocity - G @ C @ G.T @ momentum - inverse @ xi
    own = -inverse @ x.potential_gradient + (J2 - D) @ x.factor.T @ x.velocity
    return np.linalg.solve(G, flow - added - own + A @ rate), np.concatenate([rate, sign * inverse.T @ momentum])


def integral_loop(x, state, force, transposed=True, sign=1.0):
    """(3.45) with blocks (p, ξ) = −sign B̄, (ξ, p) = sign B̄ᵀ; printed with sign = −1."""
    z, xi = state[:3], state[3:]
    inverse = np.linalg.inv(x.factor)
    J_R = np.zeros((12, 12))
    J_R[:9, :9] = matrices(x)
    J_R[:3, :3] = -K_I @ np.linalg.inv(K_P)
    J_R[3:6, 9:], J_R[9:, 3:6] = -sign * inverse, sign * inverse.T
    momentum = integral_hat(x, z, transposed)
    return J_R @ np.concatenate([K_P @ (x.position - GOAL), momentum, np.linalg.solve(K_Z, z), xi - force])


def test_e13_the_integral_of_the_output():
    """(3.41), (3.42), (3.45), (3.51): ξ̇ = −B̄ᵀp̃ and K_i without Tᵀ."""

    def integral_off(force=FORCE, sign=1.0, transposed=True, loop_sign=1.0):
        return mismatch(
            lambda x, s: integral_law(x, s, force, sign=sign, transposed=transposed),
            lambda x, s: np.concatenate([x.position - GOAL, integral_hat(x, s[:3], transposed), s]),
            lambda x, s: integral_loop(x, s, force, transposed, loop_sign),
            6,
            force,
        )

    assert integral_off() < EXACT
    assert integral_off(sign=-1.0, loop_sign=-1.0) > WRONG  # −Bξ in (3.42) is the block −B̄, whatever ξ̇
    assert integral_off(sign=-1.0) > WRONG
    assert integral_off(transposed=False) > WRONG

    def fastest(sign):
        """Return the largest real part of the eigenvalues of the true closed loop about the goal."""

        def rate(y):
            x = arm().at(y[:3], y[3:6])
            torque, own = integral_law(x, y[6:], np.zeros(3), sign=sign)
            return np.concatenate([y[3:6], x.acceleration(torque), own])

        slope = approx_fprime(np.concatenate([GOAL, np.zeros(9)]), rate, 1e-6)
        return np.linalg.eigvals(slope).real.max()

    assert fastest(1.0) < 0.0
    assert fastest(-1.0) > 0.1  # as printed the loop is unstable


def test_e35_a_bar_and_two_signs():
    """(3.40): q_d + K_p⁻¹B f_e, not B̄f_e; (3.49): −D̄Y for +; (3.50): p̃̇ = −B̄c₁, not B̄(c₁ + f_e)."""
    inverse = np.linalg.inv(arm().at(GOAL).factor)
    assert np.abs(rest_rate(GOAL + np.linalg.solve(K_P, FORCE), np.zeros(3), measured=True)).max() < 1e-10
    assert np.abs(rest_rate(GOAL + np.linalg.solve(K_P, inverse @ FORCE), np.zeros(3), measured=True)).max() > 0.1
    excess = np.array([0.5, -1.0, 2.0])  # c₁ = ξ − f_e
    x, state = arm().at(GOAL), np.concatenate([np.zeros(3), FORCE + excess])
    rate = along(lambda y, s: integral_hat(y, s[:3]), x, state, *integral_law(x, state, FORCE), FORCE)
    np.testing.assert_allclose(-inverse @ excess, rate, atol=1e-8)
    assert np.abs(inverse @ (excess + FORCE) - rate).max() > 0.1
    worst = 0.0
    for x, state in states(arm(), 6):
        flow, z = integral_loop(x, state, FORCE), state[:3]
        slope = np.concatenate([K_P @ (x.position - GOAL), integral_hat(x, z), np.linalg.solve(K_Z, z)])
        loss = slope @ flow[:9] + (state[3:] - FORCE) @ flow[9:]
        _, _, D, G = bar(x)
        U = np.zeros((9, 9))
        U[:3, :3], U[3:6, 3:6], U[6:, 6:] = K_I @ np.linalg.inv(K_P), D + G @ C @ G.T, Y.T @ D @ Y
        mixed = np.zeros((9, 9))
        mixed[3:6, 6:], mixed[6:, 3:6] = D @ Y, Y.T @ D
        assert -slope @ (U + mixed) @ slope == pytest.approx(loss, rel=1e-9)
        worst = max(worst, abs(-slope @ (U - mixed) @ slope - loss) / abs(loss))
    assert worst > WRONG


def test_e37_the_output_in_the_original_coordinates():
    """(3.33): ŷ = Gᵀq̇ − GᵀT⁻ᵀA z; printed with T⁻¹."""
    for x, z in states(arm(), 3):
        _, _, _, G = bar(x)
        output, inverse = G.T @ hat(x, z), np.linalg.inv(x.factor)
        np.testing.assert_allclose(x.input_matrix.T @ (x.velocity - inverse.T @ A @ z), output, atol=1e-12)
        assert np.abs(x.input_matrix.T @ (x.velocity - inverse @ A @ z) - output).max() > 0.01


def test_the_shift_that_3_40_prints_is_seen_in_a_simulation_of_the_measured_law_only():
    system = make_system("pera_shoulder")
    goal, force = np.array([1.0, 0.5]), np.array([3.0, -3.0])
    for measured, rest in ((True, goal + force / 15.0), (False, goal)):
        made = ForceFeedback(
            system, goal=goal, stiffness=15.0, damping=10.0, coupling=[0.5, 0.7], force_gain=2.0, measured=measured
        )
        log = simulate(system, made, duration=25.0, dt=1e-2, q0=goal, disturbance=force)
        np.testing.assert_allclose(log.position[-1], rest, atol=2e-3)


def dissipation(D, damped):
    """K of (3.15), with the sign of E11."""
    return np.block([[D + damped, D @ Y], [Y.T @ D, Y.T @ D @ Y]])


def test_e40_friction_in_every_joint():
    """(3.15): K is positive definite where D̄ is, and A invertible; with D̄ ≥ 0, all that is asked, it need not be."""
    for x, _ in states(arm(), 0):
        _, _, D, G = bar(x)
        damped = G @ C @ G.T
        assert np.linalg.eigvalsh(dissipation(D, damped))[0] > 1e-6  # this arm has friction in all joints
        inverse = np.linalg.inv(x.factor)
        for friction in (np.zeros(3), x.damping * [1.0, 1.0, 0.0]):  # D ≥ 0 as (2.2) has it
            K = dissipation(inverse @ np.diag(friction) @ inverse.T, damped)
            assert np.linalg.eigvalsh(K)[0] < 1e-9 * np.linalg.eigvalsh(K)[-1]
        assert np.linalg.matrix_rank(dissipation(np.zeros((3, 3)), damped), tol=1e-9) == 3
        # with the printed sign the eigenvalues are the same: the claim fails for either
        mirror = np.diag([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
        printed = mirror @ dissipation(D, damped) @ mirror
        np.testing.assert_allclose(printed[:3, 3:], -D @ Y, atol=1e-12)
        np.testing.assert_allclose(
            np.linalg.eigvalsh(printed), np.linalg.eigvalsh(dissipation(D, damped)), rtol=1e-9, atol=1e-12
        )


def test_e41_the_product_of_two_gains():
    """(3.49): K_iK_p⁻¹ of K_i, K_p > 0 may be indefinite; U ≥ 0 where K_iᵀK_p + K_pK_i ≥ 0. And H_i grows without."""
    turn = np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]])
    K_i, K_p = np.diag([20.0, 1.0]), turn @ np.diag([1.0, 20.0]) @ turn.T
    for matrix in (K_i, K_p):
        assert np.linalg.eigvalsh(matrix)[0] > 0.9  # as printed
    ratio = K_i @ np.linalg.inv(K_p)
    assert np.linalg.eigvalsh(0.5 * (ratio + ratio.T))[0] < -1.0
    assert np.linalg.eigvalsh(K_i.T @ K_p + K_p @ K_i)[0] < 0.0
    # with p̃ = z = 0 the rate of H_i is −gᵀK_iK_p⁻¹g, g = K_p q̃: it grows where that is negative
    gradient = np.linalg.eigh(0.5 * (ratio + ratio.T))[1][:, 0]
    assert -gradient @ ratio @ gradient > 1.0
    # where the corrected condition holds, so does U ≥ 0: the two are congruent by K_p
    draw, seen = np.random.default_rng(4), {True: 0, False: 0}
    for _ in range(200):
        turns = [np.linalg.qr(draw.normal(size=(2, 2)))[0] for _ in range(2)]
        K_i, K_p = (each @ np.diag([1.0, draw.uniform(1.0, 100.0)]) @ each.T for each in turns)
        ratio = K_i @ np.linalg.inv(K_p)
        holds = np.linalg.eigvalsh(K_i.T @ K_p + K_p @ K_i)[0] >= 0.0
        assert holds == (np.linalg.eigvalsh(ratio + ratio.T)[0] >= 0.0)
        seen[bool(holds)] += 1
    assert min(seen.values()) > 5
    for gain in (np.diag([1.0, 0.5]), np.diag([3.0, 7.0])):  # diagonal ones, as in section 3.4
        ratio = gain @ np.linalg.inv(np.diag([15.0, 4.0]))
        assert np.linalg.eigvalsh(ratio + ratio.T)[0] > 0.0


def test_e42_the_constant_of_the_forced_energy():
    """(3.38): P̂ is positive definite for a K_f that is large enough, not for any K_f > 0."""
    for x, _ in states(arm(), 0):
        inverse, _, _, G = bar(x)
        upper = np.linalg.solve(G @ C @ G.T, inverse)
        lower = np.linalg.solve(Y, upper)
        enough = upper.T @ upper + lower.T @ K_Z @ lower

        def least(K_f, upper=upper, lower=lower):
            zero, one = np.zeros((3, 3)), np.eye(3)
            P = np.block(
                [
                    [K_P, zero, zero, zero],
                    [zero, one, zero, upper],
                    [zero, zero, np.linalg.inv(K_Z), -lower],
                    [zero, upper.T, -lower.T, K_f],
                ]
            )
            return np.linalg.eigvalsh(P)[0]

        assert least(enough + 1e-3 * np.eye(3)) > 0.0
        assert least(0.5 * enough) < 0.0
        assert np.linalg.eigvalsh(0.5 * enough)[0] > 0.0  # a K_f > 0, as printed
