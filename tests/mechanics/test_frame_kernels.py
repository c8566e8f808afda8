"""The kernels about a frame against their definitions, in every implementation that is here."""

import contextlib
import importlib

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.linalg import sqrtm
from scipy.spatial.transform import Rotation

from tests.finite_differences import derivative
from tests.mechanics.layouts import LAYOUTS

IMPLEMENTATIONS = {"numpy": importlib.import_module("phcontrol.mechanics._numpy_frames")}
with contextlib.suppress(ImportError):  # where no compiler was at hand
    IMPLEMENTATIONS["compiled"] = importlib.import_module("phcontrol.mechanics._compiled_frames")

every_implementation = pytest.mark.parametrize("kernels", IMPLEMENTATIONS.values(), ids=IMPLEMENTATIONS)
cases = given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.sampled_from([3, 6]),
    joints=st.integers(6, 12),
    lay=st.sampled_from(sorted(LAYOUTS)).map(LAYOUTS.get),
)


class Case:
    """A Jacobian of full rank, a mass matrix, and what follows by its definition."""

    def __init__(self, seed, rows, joints):
        self.generator = generator = np.random.default_rng(seed)
        while True:
            self.jacobian = generator.normal(size=(rows, joints))
            if np.linalg.svd(self.jacobian)[1][-1] > 0.1:
                break
        root = generator.normal(size=(joints, joints))
        self.mass = root @ root.T + joints * np.eye(joints)
        self.factor = np.linalg.cholesky(self.mass)
        self.reduced = np.linalg.solve(self.factor, self.jacobian.T)
        self.mobility = self.jacobian @ np.linalg.solve(self.mass, self.jacobian.T)
        self.velocity, self.force = generator.normal(size=(2, joints))


def close(found, expected, tolerance=1e-10):
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(1.0, float(np.abs(expected).max())))


@every_implementation
@cases
def test_the_task_space_is_its_definition(kernels, seed, rows, joints, lay):
    case = Case(seed, rows, joints)
    weight = np.diag(case.generator.uniform(0.5, 12.0, size=rows))
    found = kernels.task_space(lay(case.jacobian), lay(case.factor), lay(np.sqrt(weight)))
    square = case.jacobian @ case.jacobian.T
    values = np.linalg.eigvals(weight @ np.linalg.inv(square)).real
    expected = case.reduced, case.mobility, square, np.sqrt((values**4).sum())
    for one, other in zip(found, expected, strict=True):
        close(one, other, 1e-9)
    flat = case.jacobian.copy()
    flat[1] = 0.0
    assert kernels.task_space(lay(flat), lay(case.factor), lay(np.sqrt(weight)))[3] == np.inf


@every_implementation
@cases
def test_without_the_task_a_force_does_not_accelerate_the_frame(kernels, seed, rows, joints, lay):
    case = Case(seed, rows, joints)
    found = kernels.without_task(*map(lay, (case.jacobian, case.factor, case.reduced, case.mobility)), lay(case.force))
    close(case.jacobian @ np.linalg.solve(case.mass, found), np.zeros(rows), 1e-9)
    push = case.jacobian.T @ np.linalg.solve(case.mobility, case.jacobian @ np.linalg.solve(case.mass, case.force))
    close(found, case.force - push)


@every_implementation
@cases
def test_the_hands_damping_is_its_definition(kernels, seed, rows, joints, lay):
    case, rate = Case(seed, rows, joints), 3.7
    root = case.generator.normal(size=(rows, rows))
    given_to = case.jacobian, root, case.mobility, case.mass, case.velocity
    found = kernels.hand_damping(*map(lay, given_to), rate)
    J = case.jacobian
    damping = J.T @ root @ root.T @ J + rate * (case.mass - J.T @ np.linalg.inv(case.mobility) @ J)
    close(found, damping @ case.velocity, 1e-9)


@every_implementation
def test_a_mobility_that_is_not_positive_definite_is_refused(kernels):
    J, T = np.eye(3, 4), np.eye(4)
    with pytest.raises(ArithmeticError):
        kernels.without_task(J, T, J.T, np.diag([1.0, 1.0, -1.0]), np.ones(4))
    with pytest.raises(ArithmeticError):
        kernels.hand_damping(J, np.eye(3), np.zeros((3, 3)), T, np.ones(4), 1.0)


@every_implementation
@cases
def test_the_damping_root_is_that_of_the_modes(kernels, seed, rows, joints, lay):
    """D_x = X Xᵀ is 2ζ L (LᵀBL)^(−½)Lᵀ, L of both roots, the second turned with the frame."""
    case, turn = Case(seed, rows, joints), Rotation.random(random_state=seed).as_matrix()
    ratio = case.generator.uniform(0.05, 3.0)
    linear, turning = (5.0 * np.eye(3) + case.generator.normal(size=(3, 3)) for _ in range(2))
    L = linear if rows == 3 else np.block([[linear, np.zeros((3, 3))], [np.zeros((3, 3)), turn @ turning]])
    free = (None, None) if rows == 3 else (lay(turning), lay(turn))
    found = kernels.damping_root(lay(linear), *free, lay(case.mobility), ratio)
    expected = 2.0 * ratio * L @ np.linalg.inv(sqrtm(L.T @ case.mobility @ L).real) @ L.T
    close(found @ found.T, expected, 1e-8)


@every_implementation
@pytest.mark.parametrize("rows", [3, 6])
def test_a_mode_that_moves_nothing_is_bounded_by_the_others(kernels, rows):
    singular = Case(3, rows, 7).mobility
    singular[:, 0] = singular[0] = 0.0
    free = (None, None) if rows == 3 else (np.eye(3), np.eye(3))
    found = kernels.damping_root(np.eye(3), *free, singular, 0.5)
    largest = np.linalg.eigvalsh(singular)[-1]
    np.testing.assert_allclose((found @ found.T)[0, 0], (1e-12 * largest) ** -0.5, rtol=1e-6)


@every_implementation
def test_a_damping_root_of_what_is_not_finite_comes_back_not_finite(kernels):
    """Soon, and without an error: the torque that it makes is refused."""
    found = kernels.damping_root(np.eye(3), np.eye(3), np.eye(3), np.full((6, 6), np.nan), 0.7)
    assert not np.isfinite(found).any()


@every_implementation
@cases
def test_the_motion_of_a_right_inverse_is_its_derivative(kernels, seed, rows, joints, lay):
    """Along B + Ḃh, w + ẇh, and a Q + Q̇h that need not be symmetric, or none."""
    case = Case(seed, rows, joints)
    rate, desired = 0.1 * case.generator.normal(size=(rows, joints)), case.generator.normal(size=(2, rows))
    Q = 0.05 * case.generator.normal(size=(2, rows, rows)) + 0.5 * np.eye(rows)

    def along(h, regularised):
        B, w = case.jacobian + h * rate, desired[0] + h * desired[1]
        A = B @ B.T + (Q[0] + h * Q[1]) * regularised
        return B.T @ np.linalg.solve(A, w)

    half = rate @ case.jacobian.T
    for regularised in (False, True):
        square = case.jacobian @ case.jacobian.T + Q[0] * regularised
        square_rate = lay(half + half.T + Q[1]) if regularised else None
        s, s_rate = kernels.right_inverse_motion(
            lay(case.jacobian), lay(rate), lay(square), square_rate, lay(desired[0]), lay(desired[1])
        )
        close(s, along(0.0, regularised), 1e-9)
        expected = derivative(lambda h, regularised=regularised: along(h, regularised), 1e-4)
        close(s_rate, expected, 1e-6)


@every_implementation
def test_no_motion_is_found_where_the_inverse_is_singular(kernels):
    for part in kernels.right_inverse_motion(
        np.zeros((3, 4)), np.zeros((3, 4)), np.zeros((3, 3)), None, np.ones(3), np.ones(3)
    ):
        np.testing.assert_array_equal(part, np.full(4, np.nan))


@every_implementation
@cases
def test_the_wrench_of_a_frame_is_the_slope_of_its_energy(kernels, seed, rows, joints, lay):
    """Ψ = ½eᵀK e + Fᵀe + ⟨M, R_dᵀR⟩ along a motion of the frame is the wrench's power."""
    generator = np.random.default_rng(seed)
    R, R_d = Rotation.random(2, random_state=seed).as_matrix()
    r, r_d, F = generator.normal(size=(3, 3))
    K, M = generator.normal(size=(2, 3, 3))
    K = K + K.T
    twist = generator.normal(size=6)

    def energy(h, K, F, M, R_d):
        e = r + h * twist[:3] - r_d
        return 0.5 * e @ K @ e + F @ e + np.vdot(M, R_d.T @ Rotation.from_rotvec(h * twist[3:]).as_matrix() @ R)

    none = np.zeros((3, 3))
    for stiffness, force, turning in ((K, F, M), (None, F, M), (K, None, None), (None, None, M), (K, F, None)):
        for goal_turn in (R_d, None):
            found = kernels.frame_wrench(
                *map(lay, (r, R, r_d)),
                *(None if one is None else lay(one) for one in (goal_turn, stiffness, force, turning)),
            )
            parts = (
                none if stiffness is None else stiffness, np.zeros(3) if force is None else force,
                none if turning is None else turning, np.eye(3) if goal_turn is None else goal_turn,
            )  # fmt: skip
            slope = derivative(lambda h, parts=parts: np.array([energy(h, *parts)]), 1e-3)[0]
            assert found @ twist == pytest.approx(slope, abs=1e-7 * (1.0 + abs(slope)))


@every_implementation
@given(seed=st.integers(0, 2**32 - 1), waves=st.integers(0, 3), lay=st.sampled_from(sorted(LAYOUTS)).map(LAYOUTS.get))
@example(seed=113, waves=3, lay=np.ascontiguousarray)  # fast enough to need the smaller step
def test_a_point_of_a_curve_and_its_derivatives(kernels, seed, waves, lay):
    generator = np.random.default_rng(seed)
    table, rate = generator.normal(size=(2 + 2 * waves, 4)), generator.uniform(0.3, 2.0)
    s, speed, acceleration = generator.normal(size=3)
    axis = generator.normal(size=3)
    axis /= np.linalg.norm(axis)
    still = Rotation.random(random_state=seed)
    turn = np.cross(axis, np.eye(3)).T
    across = turn @ still.as_matrix()
    turned = tuple(map(lay, (still.as_matrix(), across, turn @ across, axis)))

    def along(h):
        place = s + speed * h + 0.5 * acceleration * h * h
        often = rate * place * np.arange(1, waves + 1)
        return np.concatenate([[1.0, place], np.cos(often), np.sin(often)]) @ table

    def motion(h):
        return derivative(lambda step: along(h + step), 1e-3)

    value = along(0.0)
    r, R, twist, twist_rate = kernels.curve_point(lay(table), rate, s, speed, acceleration, turned)
    close(r, value[:3], 1e-13)
    close(R, Rotation.from_rotvec(value[3] * axis).as_matrix() @ still.as_matrix(), 1e-13)
    spread = np.block([[np.eye(3), np.zeros((3, 1))], [np.zeros((3, 3)), axis[:, None]]])
    close(twist, spread @ motion(0.0), 1e-7)
    fastest = max(1.0, rate * waves * abs(speed))  # [rad/s]: of it differences must see a small part of a turn
    close(twist_rate, spread @ derivative(motion, 1e-2 / fastest), 1e-5)
    free = kernels.curve_point(lay(table), rate, s, speed, acceleration, None)
    assert free[1] is None
    for one, other in zip((free[0], free[2], free[3]), (r, twist[:3], twist_rate[:3]), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14)


@pytest.mark.skipif("compiled" not in IMPLEMENTATIONS, reason="the kernels were not compiled")
def test_the_compiled_kernels_refuse_what_they_cannot_read():
    compiled, J, T, one, five = IMPLEMENTATIONS["compiled"], np.eye(3, 4), np.eye(4), np.eye(3), np.ones(5)
    v3, v4 = np.ones(3), np.ones(4)
    for call in (
        lambda: compiled.task_space(J, one, one),
        lambda: compiled.task_space(J, T, T),
        lambda: compiled.task_space(v3, T, one),
        lambda: compiled.task_space(J.astype(np.float32), T, one),
        lambda: compiled.without_task(J, T, J.T, one, v3),
        lambda: compiled.without_task(J, T, J, one, v4),
        lambda: compiled.hand_damping(J, one, one, one, v4, 1.0),
        lambda: compiled.hand_damping(J, one, one, T, five, 1.0),
        lambda: compiled.damping_root(one, None, None, np.eye(6), 0.5),
        lambda: compiled.damping_root(one, one, None, np.eye(6), 0.5),
        lambda: compiled.right_inverse_motion(J, J.T, one, None, v3, v3),
        lambda: compiled.right_inverse_motion(J, J, one, T, v3, v3),
        lambda: compiled.frame_wrench(v3, one, v4, None, None, None, None),
        lambda: compiled.frame_wrench(v3, one, v3, None, None, None, T),
        lambda: compiled.curve_point(np.ones((3, 4)), 1.0, 0.0, 0.0, 0.0, None),
        lambda: compiled.curve_point(np.ones((2, 3)), 1.0, 0.0, 0.0, 0.0, None),
        lambda: compiled.curve_point(np.ones((2, 4)), 1.0, 0.0, 0.0, 0.0, (one, one, one)),
        lambda: compiled.curve_point(np.ones((2, 4)), 1.0, 0.0, 0.0, 0.0, (one, one, v3, v3)),
    ):
        with pytest.raises(ValueError, match="array"):
            call()
    with pytest.raises(TypeError, match="takes 3 arguments"):
        compiled.task_space(J, T)
    with pytest.raises(TypeError):
        compiled.hand_damping(J, one, one, T, v4, "much")
