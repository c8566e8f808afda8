"""Errata of chapter 5: camera, servo laws, and the example's arm."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import interaction_matrix
from phcontrol.vision.interaction import back_project, project
from tests.conftest import make_system
from tests.finite_differences import derivative, gradient
from tests.thesis.errata.loop import EXACT, arm, mismatch, states
from tests.thesis.errata.test_chapter_3 import WRONG, bar

F, LENGTH = 0.01, 0.038  # [m]
SEEN = np.array([0.002, -0.001, 0.0015])
A2, AC2, AC3, G = 0.32, 0.16, 0.14, 9.81  # of section 5.4 [m, m/s²]
MASSES, INERTIAS = (2.9, 2.9, 1.0), (1.0, 1.0, 0.5)
POSTURES = np.random.default_rng(5).uniform(-np.pi, np.pi, size=(10, 3))


def test_e16_the_length_shrinks_as_the_object_goes_away():
    """(5.2), third row: f/Z for −l/Z."""
    point, velocity = back_project(SEEN, F, LENGTH), np.array([0.1, -0.2, 0.3])
    rate = derivative(lambda h: project(point + h * velocity, F, LENGTH), 1e-4)
    mu, nu, size = SEEN
    Z = point[2]
    corrected, printed = (
        np.array([[F / Z, 0.0, -mu / Z], [0.0, F / Z, -nu / Z], [0.0, 0.0, last]]) @ velocity
        for last in (-size / Z, F / Z)
    )
    np.testing.assert_allclose(corrected, rate, rtol=1e-9)
    assert abs(printed[2] - rate[2]) > 2.0 * abs(rate[2])


def rodrigues(w):
    """Return the rotation by a vector."""
    angle = np.linalg.norm(w)
    S = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]) / (angle or 1.0)
    return np.eye(3) + np.sin(angle) * S + (1.0 - np.cos(angle)) * S @ S


def test_e17_the_interaction_matrix_of_a_moving_camera():
    """(5.3): −l²/(fL) for +; and the twist is the camera's in its own frame, not in the inertial one."""
    mu, nu, size = SEEN
    draw = np.random.default_rng(2)
    turned = rodrigues(np.array([0.5, -0.8, 0.3]))  # the camera's axes in the world
    point = turned @ back_project(SEEN, F, LENGTH)
    for _ in range(5):
        v, w = draw.normal(size=3), draw.normal(size=3)  # in the camera's frame

        def seen(h, v=v, w=w):
            rotation = turned @ rodrigues(h * w)
            return project(rotation.T @ (point - h * turned @ v), F, LENGTH)

        rate, twist = derivative(seen, 1e-4), np.concatenate([v, w])
        matrix = interaction_matrix(SEEN, F, LENGTH)
        np.testing.assert_allclose(matrix @ twist, rate, atol=1e-9 * np.abs(rate).max())
        printed = matrix.copy()
        printed[2, 2] = -(size**2) / (F * LENGTH)
        assert abs((printed @ twist - rate)[2]) > 0.01 * abs(v[2] * size**2 / (F * LENGTH))
        inertial = np.concatenate([turned @ v, turned @ w])
        assert np.abs(matrix @ inertial - rate).max() > 0.05 * np.abs(rate).max()


K_TAU = np.diag([1.0, 1.0, 0.5])
K_P = np.diag([0.5, 0.6, 0.7])
WIDE = np.array([0.4, -0.3, 0.8])  # features of order 1, so that no unit hides an error


def image_jacobian(x, features):
    """Return Δ̄ for a camera of focal length 1 and an object of length 1."""
    return interaction_matrix(features, 1.0, 1.0) @ x.frame_jacobian("camera", "local")


def features_of(state):
    """Return features that can be: l > 0."""
    return WIDE + 0.1 * np.tanh(state)


def reduction(x, tau, gravity=True):
    """(5.21) with τ_d = 0, or without ∂V/∂q as printed; the features' rate Δ̄q̇ beside."""
    inverse, J2, D, Gbar = bar(x)
    delta = image_jacobian(x, tau)
    hatted = x.factor.T @ (x.velocity + K_TAU @ tau)
    v = -K_P @ hatted + (J2 - D) @ x.factor.T @ K_TAU @ tau - x.factor_rate.T @ K_TAU @ tau
    v = v - x.factor.T @ K_TAU @ (delta @ inverse.T @ hatted - delta @ K_TAU @ tau)
    if gravity:
        v = v + inverse @ x.potential_gradient
    return np.linalg.solve(Gbar, v), delta @ x.velocity


def test_e18_the_servo_laws_carry_the_arm():
    """(5.16), (5.21): T⁻¹∂V/∂q is missing, and with it (5.17) is not the closed loop."""

    def hatted(x, tau):
        return x.factor.T @ (x.velocity + K_TAU @ tau)

    def promise(x, tau):
        _, J2, D, _ = bar(x)
        return (J2 - D - K_P) @ hatted(x, tau)

    assert mismatch(reduction, hatted, promise, 3) < EXACT
    assert mismatch(lambda x, tau: reduction(x, tau, gravity=False), hatted, promise, 3) > WRONG


def theta(x, tau):
    """θ of (5.26)."""
    return x.factor.T @ np.linalg.pinv(image_jacobian(x, tau)) @ tau


def hamiltonian(x, tau, sign=1.0):
    """(5.27) to (5.29), with the sign of ∂θ/∂q T⁻ᵀ in β₁ as corrected, or −1 as printed."""
    inverse, J2, D, Gbar = bar(x)
    delta = image_jacobian(x, tau)
    by_position = gradient(lambda q: theta(x.system.at(q), tau), x.position).T
    by_feature = gradient(lambda y: theta(x, y), tau).T
    pseudo, tilde = np.linalg.pinv(delta), x.factor.T @ x.velocity + theta(x, tau)
    first = sign * by_position @ inverse.T + by_feature @ delta @ inverse.T + K_P
    second = -by_position @ pseudo - by_feature
    v = inverse @ x.potential_gradient + (J2 - D) @ x.factor.T @ pseudo @ tau
    return np.linalg.solve(Gbar, v - first @ tilde - second @ tau - inverse @ delta.T @ tau), delta @ x.velocity


def seen_states():
    """Return states whose image Jacobian is far from singular."""
    found = [(x, features_of(tau)) for x, tau in states(arm(), 3, 20)]
    return [(x, tau) for x, tau in found if np.linalg.svd(image_jacobian(x, tau))[1][-1] > 0.05][:5]


def hamiltonian_off(law, monkeypatch):
    monkeypatch.setattr("tests.thesis.errata.loop.states", lambda system, size: seen_states())

    def coordinates(x, tau):
        return np.concatenate([x.factor.T @ x.velocity + theta(x, tau), tau])

    def promise(x, tau):
        """Return the rates of (5.46)."""
        inverse, J2, D, _ = bar(x)
        delta = image_jacobian(x, tau)
        tilde = coordinates(x, tau)[:3]
        return np.concatenate(
            [
                (J2 - D - K_P) @ tilde - inverse @ delta.T @ tau,
                delta @ inverse.T @ tilde - delta @ np.linalg.pinv(delta) @ tau,
            ]
        )

    return mismatch(law, coordinates, promise, 3)


def test_e19_the_derivative_of_the_shift_in_beta_1(monkeypatch):
    """(5.28): −(∂θ/∂q)T⁻ᵀ for +."""
    assert len(seen_states()) == 5
    assert hamiltonian_off(hamiltonian, monkeypatch) < 1e-6  # ∂θ by finite differences
    assert hamiltonian_off(lambda x, tau: hamiltonian(x, tau, -1.0), monkeypatch) > WRONG


def test_e35_the_sign_of_the_features_in_5_36():
    """(5.36): q̇ = −Δ̄†τ̄ + T⁻ᵀp̃, as (5.32) has it; printed with +."""
    for x, tau in seen_states():
        pseudo, inverse = np.linalg.pinv(image_jacobian(x, tau)), np.linalg.inv(x.factor)
        tilde = x.factor.T @ x.velocity + theta(x, tau)
        np.testing.assert_allclose(-pseudo @ tau + inverse.T @ tilde, x.velocity, atol=1e-10)
        assert np.abs(pseudo @ tau + inverse.T @ tilde - x.velocity).max() > 0.1


def printed_mass(q, a2, ac3, masses, inertias):
    """(5.49) as printed."""
    _, q2, q3 = q
    (_, m2, m3), (i1, i2, i3) = masses, inertias
    first = i1 + i2 + i3 + 0.5 * ac3**2 * (m2 + m3) + 0.5 * a2**2 * m3 * (1.0 + np.cos(2.0 * q2))
    first += ac3**2 * (
        0.5 * m2 * np.cos(2.0 * q2)
        + 0.5 * m3 * np.cos(2.0 * (q2 + q3))
        + a2**2 * m3 * (np.cos(q3) + np.cos(2.0 * q2 + q3))
    )
    second = i2 + i3 + ac3**2 * (m2 + m3) + a2**2 * m3 * (1.0 + 2.0 * ac3**2 * np.cos(q3))
    third = i3 + ac3**2 * m3 * (1.0 + a2**2 * np.cos(q3))
    last = i3 + ac3**2 * m3
    return np.array([[first, 0.0, 0.0], [0.0, second, third], [0.0, third, last]])


def corrected_mass(q, a2, ac2, ac3, masses, inertias):
    """The same arm by hand: points at the centres of mass, and spheres of inertia 𝓘ᵢ."""
    _, q2, q3 = q
    (_, m2, m3), (i1, i2, i3) = masses, inertias
    reach = a2 * np.cos(q2) + ac3 * np.cos(q2 + q3)
    first = i1 + i2 + i3 + m2 * ac2**2 * np.cos(q2) ** 2 + m3 * reach**2
    last = i3 + m3 * ac3**2
    third = last + m3 * a2 * ac3 * np.cos(q3)
    second = i2 + i3 + m2 * ac2**2 + m3 * (a2**2 + ac3**2 + 2.0 * a2 * ac3 * np.cos(q3))
    return np.array([[first, 0.0, 0.0], [0.0, second, third], [0.0, third, last]])


def test_e20_the_inertia_has_the_dimension_of_one():
    """(5.49): a_C3²a₂²m is no inertia: in other units of length it is another arm."""
    system = make_system("pera_shoulder_elbow")
    for q in POSTURES:
        M = system.at(q).mass_matrix
        np.testing.assert_allclose(corrected_mass(q, A2, AC2, AC3, MASSES, INERTIAS), M, atol=1e-12)
        assert np.abs(printed_mass(q, A2, AC3, MASSES, INERTIAS) - M).max() > 1e-3
        inches = 1.0 / 0.0254
        scaled = [value * inches**2 for value in INERTIAS]
        np.testing.assert_allclose(
            corrected_mass(q, A2 * inches, AC2 * inches, AC3 * inches, MASSES, scaled),
            M * inches**2,
            rtol=1e-9,
            atol=1e-9,
        )
        misfit = printed_mass(q, A2 * inches, AC3 * inches, MASSES, scaled) / inches**2
        assert np.abs(misfit - printed_mass(q, A2, AC3, MASSES, INERTIAS)).max() > 0.1


def placed(q, a3, a2=A2):
    """Return the pose of a point on the forearm by the Denavit–Hartenberg parameters of table 5.1: position, axes."""
    pose = np.eye(4)
    for angle, (a, alpha) in zip(q, ((0.0, np.pi / 2), (a2, 0.0), (a3, np.pi / 2)), strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        pose = pose @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, 0], [0, 0, 0, 1]])
    return pose


def by_hand(q, a3, printed):
    """Return 𝒥 of (5.56), (5.57), with the three entries of E21 as corrected or as printed."""
    s1, c1 = np.sin(q[0]), np.cos(q[0])
    c2, s2, c23, s23 = np.cos(q[1]), np.sin(q[1]), np.cos(q[1] + q[2]), np.sin(q[1] + q[2])
    reach, height = A2 * c2 + a3 * c23, A2 * s2 + a3 * s23
    linear = [
        [-s1 * reach, -c1 * height, -a3 * c1 * (c23 if printed else s23)],
        [c1 * reach, -s1 * height, a3 * s1 * s23 * (1.0 if printed else -1.0)],
        [0.0, reach, a3 * c23],
    ]
    angular = [[0.0, s1, s1], [0.0, -c1, c1 if printed else -c1], [1.0, 0.0, 0.0]]
    return np.array([*linear, *angular])


def true_jacobian(q, a3):
    linear = gradient(lambda y: placed(y, a3)[:3, 3], q).T
    turning = gradient(lambda y: placed(y, a3)[:3, :3], q)
    angular = [[S[2, 1], S[0, 2], S[1, 0]] for S in (each @ placed(q, a3)[:3, :3].T for each in turning)]
    return np.vstack([linear, np.transpose(angular)])


def test_e21_the_geometric_jacobian():
    """(5.56), (5.57): +cos q₁ in J_ω; cos(q₂ + q₃), and + before sin q₁ sin(q₂ + q₃), in the third column of J_v."""
    for q in POSTURES:
        true = true_jacobian(q, AC3)
        np.testing.assert_allclose(by_hand(q, AC3, printed=False), true, atol=1e-9)
        wrong = np.abs(by_hand(q, AC3, printed=True) - true) > 1e-6
        assert {tuple(place) for place in np.argwhere(wrong).tolist()} == {(0, 2), (1, 2), (4, 2)}
        assert np.abs(by_hand(q, AC3, printed=True) - true)[4, 2] == pytest.approx(2.0 * abs(np.cos(q[0])))


def test_e33_the_jacobian_is_that_of_the_camera():
    """(5.57), (5.59) are of the forearm's centre of mass, a_c3; the camera is at (5.58), a_l3."""
    for q in POSTURES:
        camera = true_jacobian(q, 0.28)
        np.testing.assert_allclose(by_hand(q, 0.28, printed=False), camera, atol=1e-9)
        assert np.abs(by_hand(q, AC3, printed=False) - camera).max() > 0.05


def test_e32_the_weight_of_the_upper_arm():
    """(5.51): a_C3 m₂ for a_C2 m₂."""
    system, (_, m2, m3) = make_system("pera_shoulder_elbow"), MASSES

    def weight(q, lever):
        q1, q2, q3 = q
        along, across = (lever * m2 * f(q2) + m3 * (A2 * f(q2) + AC3 * f(q2 + q3)) for f in (np.cos, np.sin))
        return G * np.array([np.sin(q1) * along, np.cos(q1) * across, m3 * AC3 * np.cos(q1) * np.sin(q2 + q3)])

    for q in POSTURES:
        energy = gradient(lambda y: np.array(system.at(y).potential_energy), q)
        np.testing.assert_allclose(weight(q, AC2), energy, atol=1e-8)
        assert np.abs(weight(q, AC3) - energy).max() > 0.01


def test_e38_the_twist_is_not_differentiated():
    """(5.6): τ̇ = Δξ̇ for Δξ, by inspection: with ξ = 𝒥q̇ the next term of the same line is Δ𝒥q̇."""
    x, tau = seen_states()[0]
    jacobian = x.frame_jacobian("camera", "local")

    def moved(h):
        return x.system.at(x.position + h * x.velocity, x.velocity).frame_jacobian("camera", "local") @ x.velocity

    twist, acceleration = jacobian @ x.velocity, derivative(moved)
    delta = interaction_matrix(tau, 1.0, 1.0)
    np.testing.assert_allclose(delta @ twist, image_jacobian(x, tau) @ x.velocity, atol=1e-12)
    assert np.abs(delta @ acceleration - image_jacobian(x, tau) @ x.velocity).max() > 0.05
