"""Errata of chapter 4: force control and impedance grasping."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from phcontrol import (
    ForceControl,
    MechanicalSystem,
    StribeckFriction,
    force_control_conditions,
    load_robot,
    virtual_position,
)
from tests.finite_differences import gradient
from tests.thesis.errata.loop import EXACT, FORCE, GOAL, along, arm, mismatch, states
from tests.thesis.errata.test_chapter_3 import K_Z, WRONG, A, C, Y, bar, hat, matrices

DESIRED = np.array([1.0, 2.0, -1.0])
K_P, K_RL = np.diag([3.0, 2.0, 1.5]), np.diag([0.5, 0.4, 0.6])


def force_law(x, w, force, *, sign=1.0, inverted=True, feedforward=True, fed_state=False):
    """(4.1), (4.2), (4.9) on w = ẑ − z_d: as corrected, or with one thing as printed."""
    inverse, J2, D, G = bar(x)
    total = (J2 - D) @ x.factor.T @ x.velocity + inverse @ force
    desired = Y.T @ inverse @ DESIRED if inverted else np.linalg.solve(Y.T @ x.factor, DESIRED)  # ż_d
    rate = sign * Y.T @ total - desired
    wanted = inverse @ (x.potential_gradient - DESIRED if feedforward else x.potential_gradient)
    v = np.linalg.solve(G, wanted + A @ (w if fed_state else rate)) - C @ G.T @ hat(x, w)
    return v, rate


def force_coordinates(x, w):
    return np.concatenate([x.position, hat(x, w), w])


def force_loop(x, w, force):
    """(4.17) with f_e and the potential f_dᵀq of the feedforward (E23): the rates of q, p̂, w."""
    rate = matrices(x) @ np.concatenate([DESIRED, hat(x, w), np.linalg.solve(K_Z, w)])
    pushed = np.linalg.inv(x.factor) @ force
    rate[3:6] += pushed
    rate[6:] += Y.T @ pushed
    return rate


def printed_loop(x, w, force):
    """(4.17) as printed: neither f_e nor f_d in it."""
    return matrices(x) @ np.concatenate([np.zeros(3), hat(x, w), np.linalg.solve(K_Z, w)])


def force_off(promise=force_loop, **form):
    return mismatch(
        lambda x, w: force_law(x, w, FORCE, **form),
        force_coordinates,
        lambda x, w: promise(x, w, FORCE),
        3,
        FORCE,
    )


def test_e14_the_integral_of_the_measured_force():
    """(4.1), (4.2), (4.9): ẑ̇ = −Yᵀf̄ for +Yᵀf̄, f_d = YᵀT ż_d for ż_d = YᵀT⁻¹f_d."""
    assert force_off() < EXACT
    assert force_off(sign=-1.0) > WRONG
    assert force_off(inverted=False) > WRONG
    # where ẑ̇ = ż_d at rest, the force is f_d; with (4.2) as printed it is another
    x = arm().at(GOAL)
    corrected = np.linalg.solve(Y.T @ np.linalg.inv(x.factor), Y.T @ np.linalg.inv(x.factor) @ DESIRED)
    printed = np.linalg.solve(Y.T @ np.linalg.inv(x.factor), np.linalg.solve(Y.T @ x.factor, DESIRED))
    np.testing.assert_allclose(corrected, DESIRED, rtol=1e-12)
    assert np.abs(printed - DESIRED).max() > 0.5


def test_e23_the_desired_force_is_fed_forward():
    """(4.9), (4.17): without −f_d in u the loop does not rest where f_e = f_d; f_e is absent from the row of p̂."""
    assert force_off() < EXACT
    assert force_off(feedforward=False) > WRONG
    assert force_off(printed_loop, feedforward=False) > WRONG
    for feedforward, rests in ((True, True), (False, False)):
        x = arm().at(GOAL)
        torque, rate = force_law(x, np.zeros(3), DESIRED, feedforward=feedforward)
        moving = np.abs(np.concatenate([x.acceleration(torque, DESIRED), rate])).max()
        assert moving < 1e-10 if rests else moving > 0.5


def test_e25_the_conditions_of_the_proof():
    """(4.13) to (4.15), (4.32), (4.34): κ₁ for κ₂, ε on the wrong side: those allowed make H_ε indefinite, or grow."""
    system = MechanicalSystem(load_robot("pera_gripper"), friction=StribeckFriction(viscous=0.1))
    law = ForceControl(system, force=[3.5], damping=5.0, coupling=1.0, force_gain=1.0)
    found = force_control_conditions(law, system)

    def greatest_rate(epsilon):
        x = system.at([0.3], [0.1])
        d, c = x.transformed_damping[0, 0], 5.0 / x.mass_matrix[0, 0]
        rows = np.array([[-d - c, -d], [-d, -d]])  # of (p̂, w), A = K_z = 1
        form = np.array([[1.0, epsilon], [epsilon, 1.0]]) @ rows
        return np.linalg.eigvalsh(form + form.T)[-1]

    allowed = min(found.printed)
    assert allowed > 0.9
    assert greatest_rate(0.9 * allowed) > 0.0  # grows
    assert greatest_rate(0.999 * found.decreasing) < 0.0 < greatest_rate(1.001 * found.decreasing)
    # (4.31): Q₁ asks ε to be above what (4.32) says it must be below; both of it and Q₂ turn at 1; friction decides
    d, c = 0.1 / 0.5, 5.0 / 0.5

    def parts(epsilon):
        first = np.array([[d, d / epsilon], [d / epsilon, d]])
        second = np.array([[(d + c) / epsilon, d], [d + c, d / epsilon]])
        return [np.linalg.eigvalsh(0.5 * (Q + Q.T))[0] for Q in (first, second, first + second)]

    assert allowed == pytest.approx(1.0)
    assert parts(1.01)[0] > 0.0 > parts(0.99)[0]
    assert found.decreasing == pytest.approx(np.sqrt(4.0 * d / (4.0 * d + c)), rel=1e-9)
    assert parts(0.999 * found.decreasing)[2] > 0.0 > parts(1.001 * found.decreasing)[2]
    # (4.13): H_ε > 0 with ε below 1/sqrt(κ₂), not 1/sqrt(κ₁)
    gains = np.diag([0.5, 4.0])

    def smallest(epsilon):
        return eigh(np.block([[np.linalg.inv(gains), epsilon * np.eye(2)], [epsilon * np.eye(2), np.eye(2)]]))[0][0]

    assert smallest(0.99 / np.sqrt(4.0)) > 0.0
    assert smallest(0.99 / np.sqrt(0.5)) < 0.0


def test_e43_a_force_in_space_acts_where_the_arm_is_held():
    """(4.40): with 𝒥 of q_f, the spring to q_f does not press with F_d where it is held, by virtual work."""
    system, wanted, stiff = arm(), np.array([1.0, -2.0, 3.0]), 20.0

    def place(q):
        return np.array(system.at(q).placement("tool").translation)

    lever = gradient(place, GOAL)
    corrected = GOAL + lever @ wanted / stiff
    printed = corrected
    for _ in range(100):  # K_p(q_f − q_c) = 𝒥(q_f)ᵀF_d
        printed = GOAL + gradient(place, printed) @ wanted / stiff
    np.testing.assert_allclose(stiff * (printed - GOAL), gradient(place, printed) @ wanted, atol=1e-9)
    np.testing.assert_allclose(np.linalg.solve(lever, stiff * (corrected - GOAL)), wanted, rtol=1e-9)
    assert np.abs(np.linalg.solve(lever, stiff * (printed - GOAL)) - wanted).max() > 0.01
    found = virtual_position(system, "tool", wanted, stiff, contact=GOAL)
    np.testing.assert_allclose(found.position, corrected, atol=1e-9)


def grasp_hat(x, rest):
    """p̂ of (4.41), with q_f = GOAL."""
    return x.factor.T @ (x.velocity + K_P @ (x.position - GOAL - rest))


def grasp_law(x, rest, force, *, sign=1.0, brackets=False):
    """(4.44), (4.47): as corrected, or with the sign (E15) or the brackets (E27) as printed."""
    inverse, J2, D, G = bar(x)
    spring, momentum = K_P @ (x.position - GOAL - rest), grasp_hat(x, rest)
    output = G.T @ momentum
    rest_rate = -output + sign * spring - K_RL @ rest
    if brackets:
        mixed = (G @ inverse.T - inverse.T + J2 - D) @ x.factor.T @ spring
    else:
        mixed = (J2 - D) @ x.factor.T @ spring - inverse @ spring - G @ spring
    moved = x.factor.T @ K_P @ (x.velocity - rest_rate) + x.factor_rate.T @ spring
    v = np.linalg.solve(G, inverse @ (x.potential_gradient - force) + G @ K_RL @ rest + mixed - moved) - C @ output
    return v, rest_rate


def grasp_loop(x, rest):
    """(4.56): the rates of q̄, p̂, q_rl."""
    inverse, J2, D, G = bar(x)
    spring, momentum = K_P @ (x.position - GOAL - rest), grasp_hat(x, rest)
    slope = K_RL @ rest - spring
    return np.concatenate(
        [
            -spring + inverse.T @ momentum,
            -inverse @ spring + (J2 - D - G @ C @ G.T) @ momentum + G @ slope,
            -G.T @ momentum - slope,
        ]
    )


def grasp_off(rows=slice(None), **form):
    def coordinates(x, rest):
        return np.concatenate([x.position - GOAL, grasp_hat(x, rest), rest])[rows]

    return mismatch(
        lambda x, rest: grasp_law(x, rest, FORCE, **form),
        coordinates,
        lambda x, rest: grasp_loop(x, rest)[rows],
        3,
        FORCE,
    )


def test_e15_the_rest_length_follows_the_spring():
    """(4.44), (4.53): −K_p(q̄ − q_rl) in q̇_rl for +; (4.46): ∂H_c/∂q_rl has −K_p(q̄ − q_rl) where + is printed."""
    assert grasp_off() < EXACT
    assert grasp_off(slice(6, None), sign=-1.0) > WRONG
    error, rest = np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.2, -0.3])

    def virtual(r):
        return np.array(0.5 * (error - r) @ K_P @ (error - r) + 0.5 * r @ K_RL @ r)  # (4.38)

    slope = gradient(virtual, rest)
    np.testing.assert_allclose(-K_P @ (error - rest) + K_RL @ rest, slope, atol=1e-9)
    assert np.abs(K_P @ (error - rest) + K_RL @ rest - slope).max() > 0.5


def test_e39_the_port_of_the_rest_length_carries_power():
    """(4.46): y_rl = ∂H_c/∂q_rl; with Ḡᵀ before it, as printed, y_rlᵀu_rl of (4.45) is not the power into H_c."""
    worst = 0.0
    for x, rest in states(arm(), 3):

        def virtual(y, r):
            e = y.position - GOAL - r
            return np.array(0.5 * e @ K_P @ e + 0.5 * r @ K_RL @ r)

        torque, rest_rate = grasp_law(x, rest, FORCE)
        grown = float(along(virtual, x, rest, torque, rest_rate, FORCE))
        spring = K_P @ (x.position - GOAL - rest)
        by_arm, y_rl = spring @ x.velocity, K_RL @ rest - spring
        _, _, _, G = bar(x)
        assert by_arm + y_rl @ rest_rate == pytest.approx(grown, rel=1e-7)
        worst = max(worst, abs(by_arm + (G.T @ y_rl) @ rest_rate - grown) / abs(grown))
    assert worst > WRONG


class OneJoint:
    """A gripper of mass m without a computer: u makes m q̈ = u − d q̇ − V′ + f_e."""

    d, k_p, k_rl, c, goal, force = 0.1, 1.0, 0.5, 3.0, 0.2, 0.7

    def __init__(self, m):
        self.m = m

    def spring(self, q, r):
        return self.k_p * (q - self.goal - r)

    def rest_rate(self, q, v, r):
        return -(v + self.spring(q, r)) + self.spring(q, r) - self.k_rl * r  # E15 mended, ŷ = q̇ + K_p e for G = 1

    def as_4_47(self, q, v, r):
        """Return u of (4.47) with the brackets as printed, less V′."""
        t, e = np.sqrt(self.m), self.spring(q, r)
        mixed = (1.0 / t**2 - 1.0 / t - self.d / self.m) * t * e  # ḠT⁻ᵀ − T⁻ᵀ + J̄₂ − D̄, times TᵀK_p e
        inner = self.k_rl * r / t - self.force / t + mixed - t * self.k_p * (v - self.rest_rate(q, v, r))
        return t * inner - self.c * (v + e)

    def as_4_59(self, q, v, r, mass_rate=1.0, mass_output=None):
        """Return u of (4.59), less V′."""
        e, m = self.spring(q, r), self.m if mass_output is None else mass_output
        fed = self.k_p * mass_rate * (v - self.rest_rate(q, v, r))
        return -self.d * e - fed + self.k_rl * r - self.c * (m * v + e) - self.force

    def corrected(self, q, v, r):
        return self.as_4_59(q, v, r, self.m, 1.0) - 2.0 * self.spring(q, r)

    def excess(self, u, q, v, r):
        """Return by how much √m·(d/dt)p̂ differs from the row of p̂ of (4.56) times √m, p̂ = √m(q̇ + K_p e)."""
        e = self.spring(q, r)
        true = u - self.d * v + self.force + self.m * self.k_p * (v - self.rest_rate(q, v, r))
        promised = -e - (self.d + self.c) * (v + e) + (self.k_rl * r - e)
        return true - promised


SITUATIONS = np.random.default_rng(3).normal(size=(10, 3))


def test_e27_the_brackets_of_the_grasping_law():
    """(4.47), (4.52), (4.57): with E15 mended the row of p̂ is still off, for one joint by K_p e(3 − √m)/√m."""
    assert grasp_off() < EXACT
    assert grasp_off(brackets=True) > WRONG
    for m in (0.5, 1.0, 2.0):
        joint = OneJoint(m)
        for q, v, r in SITUATIONS:
            off = joint.excess(joint.as_4_47(q, v, r), q, v, r) / np.sqrt(m)  # of p̂̇
            assert off == pytest.approx(joint.spring(q, r) * (3.0 - np.sqrt(m)) / np.sqrt(m), abs=1e-12)
            assert joint.excess(joint.corrected(q, v, r), q, v, r) == pytest.approx(0.0, abs=1e-12)
    # (4.57): the losses are |K_p e|² + p̂ᵀ(…)p̂ + |K_rl q_rl − K_p e|²; + is printed
    worst = 0.0
    for x, rest in states(arm(), 3):

        def stored(y, r):
            e, momentum = y.position - GOAL - r, grasp_hat(y, r)
            return np.array(0.5 * (momentum @ momentum + e @ K_P @ e + r @ K_RL @ r))

        rate = float(along(stored, x, rest, *grasp_law(x, rest, FORCE), FORCE))
        _, _, D, G = bar(x)
        spring, momentum = K_P @ (x.position - GOAL - rest), grasp_hat(x, rest)
        printed, corrected = (
            -spring @ spring - momentum @ (D + G @ C @ G.T) @ momentum - np.sum((K_RL @ rest + sign * spring) ** 2)
            for sign in (1.0, -1.0)
        )
        assert corrected == pytest.approx(rate, rel=1e-6)
        worst = max(worst, abs(printed - rate) / abs(rate))
    assert worst > WRONG


def test_e28_the_grasping_law_of_a_mass_that_is_not_one():
    """(4.59): for m = 1 it is (4.47); else K_p(q̇ − q̇_rl) lacks a factor m, and C has one too many."""
    for q, v, r in SITUATIONS:
        one, half = OneJoint(1.0), OneJoint(0.5)
        assert one.as_4_59(q, v, r) == pytest.approx(one.as_4_47(q, v, r), abs=1e-12)
        # with both factors mended what is left is E27's 2K_p e; as printed it is not
        left = 2.0 * half.spring(q, r)
        assert half.excess(half.as_4_59(q, v, r, 0.5, 1.0), q, v, r) == pytest.approx(left, abs=1e-12)
        for form in ({}, {"mass_rate": 0.5}, {"mass_output": 1.0}):
            assert abs(half.excess(half.as_4_59(q, v, r, **form), q, v, r) - left) > 1e-3


def test_e35_dots_of_the_force_law():
    """(4.9), (4.16): A(ẑ − ż_d) for A(ẑ̇ − ż_d); (4.3): one sign for both forces. The caption of 4.1: q(0) = 0.30."""
    assert force_off() < EXACT
    assert force_off(fed_state=True) > WRONG
    worst = 0.0
    for x, w in states(arm(), 3):
        torque, rate = force_law(x, w, FORCE)
        hatted = along(hat, x, w, torque, rate, FORCE)
        bare = along(lambda y, _: y.transformed_momentum, x, w, torque, rate, FORCE)
        np.testing.assert_allclose(bare - A @ rate, hatted, atol=1e-8 * np.abs(hatted).max())
        desired = Y.T @ np.linalg.inv(x.factor) @ DESIRED
        worst = max(worst, np.abs(bare - A @ (w - desired) - hatted).max() / np.abs(hatted).max())
    assert worst > WRONG
    x = arm().at(GOAL)
    total = along(lambda y, _: y.momentum, x, np.zeros(0), np.zeros(3), np.zeros(0), FORCE)
    np.testing.assert_allclose(-x.potential_gradient + FORCE, total, atol=1e-8)
    assert np.abs(-(x.potential_gradient + FORCE) - total).max() > 0.5  # as (4.3) has it
    gripper = load_robot("pera_gripper")  # q(0) = 3 rad is outside what the gripper can open
    assert gripper.lower[0] <= 0.30 <= gripper.upper[0] < 3.0
