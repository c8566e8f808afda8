"""The joint motion that follows a path: against the pseudoinverse, and finite differences along a motion."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from phcontrol import FigureOfEight, FrameReference, InvalidArgumentError, resolved_motion
from phcontrol.mechanics.singular_damping import LENGTH, SINGULAR_REGION
from tests.conftest import make_system
from tests.finite_differences import derivative

FRAMES = {
    "pera": "tool",
    "panda": "panda_hand",
    "ur5": "tool0",
    "pera_shoulder_elbow": "tool",  # three joints: a position alone
    "panda_with_fingers": "panda_leftfinger",  # a prismatic joint, which another one mimics
    "tiago_no_hand": "arm_7_link",  # a prismatic torso
}
FEW_JOINTS = ("pera_shoulder_elbow",)
CASES = [(arm, rows) for arm in FRAMES for rows in (3, 6) if rows == 3 or arm not in FEW_JOINTS]
EYE = np.eye(3)


def reference(rng, rows):
    turn = EYE if rows == 6 else None
    return FrameReference(np.zeros(3), turn, rng.normal(size=rows), rng.normal(size=rows))


def rows_of(system, q, frame, rows):
    """The Jacobian's rows, and the same with angular ones times the length that makes them metres."""
    jacobian = system.at(q).frame_jacobian(frame, "local_world_aligned")[:rows]
    return jacobian, np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])[:rows, None] * jacobian


def distance(system, q, frame, rows):
    return np.linalg.svd(rows_of(system, q, frame, rows)[1], compute_uv=False)[-1]


def state(arm, rows, seed, *, near):
    """A posture well outside the singular region, or inside of it, where q is moved along a gradient of σ."""
    system, frame, rng = make_system(arm), FRAMES[arm], np.random.default_rng(seed)
    for _ in range(400):
        q = system.robot.random_position(rng, margin=0.02)
        sigma = distance(system, q, frame, rows)
        if sigma > 1.5 * SINGULAR_REGION:
            break
    if not near:
        return system, frame, q, rng
    desired = rng.uniform(0.2, 0.8) * SINGULAR_REGION
    other = q
    while distance(system, other, frame, rows) > desired:  # some posture nearer to singularity than desired
        other = nearest_singular(system, other, frame, rows)
    low, high = 0.0, 1.0  # by bisection between both
    for _ in range(60):
        middle = 0.5 * (low + high)
        if distance(system, q + middle * (other - q), frame, rows) > desired:
            low = middle
        else:
            high = middle
    return system, frame, q + high * (other - q), rng


def nearest_singular(system, q, frame, rows):
    """A step of Newton's method on σ(q) = 0."""
    sigma = distance(system, q, frame, rows)
    slope = np.array(
        [derivative(lambda h, e=e: distance(system, q + h * e, frame, rows), 1e-4) for e in np.eye(len(q))]
    )
    return q - np.clip(sigma / slope.dot(slope), 0.0, 0.3 / np.linalg.norm(slope)) * slope


@pytest.mark.parametrize(("arm", "rows"), CASES)
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_frame_moves_as_asked_with_the_least_joint_velocity(arm, rows, seed):
    system, frame, q, rng = state(arm, rows, seed, near=False)
    asked = reference(rng, rows)
    motion = resolved_motion(system.at(q, rng.normal(size=system.n)), frame, asked)
    jacobian, _ = rows_of(system, q, frame, rows)
    np.testing.assert_allclose(jacobian @ motion.velocity, asked.twist, atol=1e-10)
    expected = np.linalg.pinv(jacobian) @ asked.twist
    np.testing.assert_allclose(motion.velocity, expected, atol=1e-9 * np.abs(expected).max())
    assert not motion.missed.any()


@pytest.mark.parametrize("near", [False, True])
@pytest.mark.parametrize(("arm", "rows"), CASES)
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_acceleration_is_the_derivative_along_the_true_motion(arm, rows, near, seed):
    """Along q + q̇h while ξ_d changes by ξ̇_d: also inside the singular region, where λ changes too."""
    system, frame, q, rng = state(arm, rows, seed, near=near)
    velocity = rng.normal(size=system.n)
    velocity /= np.linalg.norm(velocity)
    asked = reference(rng, rows)
    values = np.linalg.svd(rows_of(system, q, frame, rows)[1], compute_uv=False)
    if near and values[-2] < 2.0 * values[-1]:  # two singular values that may change places: λ has a kink there
        return
    step = 2e-3 * values[-1] if near else 1e-4

    def along(h):
        later = asked._replace(twist=asked.twist + h * asked.acceleration)
        return resolved_motion(system.at(q + h * velocity, velocity), frame, later).velocity

    motion = resolved_motion(system.at(q, velocity), frame, asked)
    expected = derivative(along, step)
    np.testing.assert_allclose(motion.acceleration, expected, atol=1e-5 * np.abs(expected).max())
    assert motion.missed.any() == near


@pytest.mark.parametrize(("arm", "rows"), CASES)
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_near_singularities_it_is_damped_as_said(arm, rows, seed):
    """Against the singular values of the weighed Jacobian, each inverted to σ/(σ² + λ²)."""
    system, frame, q, rng = state(arm, rows, seed, near=True)
    asked = reference(rng, rows)
    motion = resolved_motion(system.at(q, rng.normal(size=system.n)), frame, asked)
    jacobian, weighed = rows_of(system, q, frame, rows)
    left, values, right = np.linalg.svd(weighed, full_matrices=False)
    depths = np.maximum(0.0, 1.0 - (values / SINGULAR_REGION) ** 2)
    square = (0.6 * SINGULAR_REGION) ** 2 * (1.0 - np.prod(1.0 - depths**2))
    weighed_twist = np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])[:rows] * asked.twist
    expected = right.T @ (values / (values**2 + square) * (left.T @ weighed_twist))
    np.testing.assert_allclose(motion.velocity, expected, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(motion.missed, asked.twist - jacobian @ expected, atol=1e-8)
    assert np.linalg.norm(motion.velocity) <= np.linalg.norm(weighed_twist) / (2.0 * np.sqrt(square)) * (1.0 + 1e-9)
    assert np.abs(motion.missed).max() > 0.0


@pytest.mark.parametrize("region", [0.01, 0.05, 0.3])
def test_outside_of_the_region_nothing_is_missed_and_at_its_border_nothing_jumps(region):
    """Where the quick bound ends and the eigenvalues begin, on a way through the border of the region."""
    system, frame, q, rng = state("pera", 6, 3, near=True)
    start = system.robot.near_home()
    asked, crossed = reference(rng, 6), []
    for s in np.linspace(0.0, 1.0, 201):
        x = system.at(start + s * (q - start), np.zeros(7))
        inside = distance(system, x.position, frame, 6) < region
        motion = resolved_motion(x, frame, asked, singular_region=region, singular_damping=0.5 * region)
        assert motion.missed.any() == inside
        crossed.append(inside)
    assert any(crossed) or region == 0.01
    assert region == 0.3 or not all(crossed)


def test_at_a_singularity_it_stays_finite_and_without_damping_it_does_not_lie():
    system = make_system("ur5")
    home = system.at(np.zeros(6), np.ones(6))  # stretched out
    asked = FrameReference(np.zeros(3), EYE, np.ones(6), np.ones(6))
    motion = resolved_motion(home, "tool0", asked)
    assert np.isfinite(motion.velocity).all()
    assert np.isfinite(motion.acceleration).all()
    assert np.abs(motion.missed).max() > 0.1
    plain = resolved_motion(home, "tool0", asked, singular_damping=0.0)
    assert not np.abs(plain.velocity).max() < 1e6  # huge, or NaN


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"singular_damping": -1.0}, "singular_damping: must be >= 0"),
        ({"singular_region": 0.0}, "singular_region: must be > 0"),
        ({"length": 0.0}, "length: must be > 0"),
    ],
)
def test_bad_numbers_are_refused(arguments, complaint):
    system = make_system("ur5")
    asked = FrameReference(np.zeros(3), EYE, np.ones(6), np.ones(6))
    with pytest.raises(InvalidArgumentError, match=complaint):
        resolved_motion(system.at(np.zeros(6)), "tool0", asked, **arguments)


@pytest.mark.parametrize("complete", [True, False])
def test_an_arm_under_the_torque_for_it_stays_on_the_path(complete):
    """M q̈_ref + C q̇_ref + D q̇_ref + ∂V/∂q with a spring and damper, along a figure of eight with a turning hand.

    Without (d𝒥#/dt)ξ_d in q̈_ref the hand is 10⁻⁵ m and more away, so that what is seen here is its effect.
    """
    system, frame = make_system("panda"), "panda_hand"
    q = np.array([0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.6])
    path = FigureOfEight(frame, system.at(q).placement(frame), 0.2, 0.1, 4.0, turn=0.4)

    def error(x, t):
        place, asked = x.placement(frame), path.at(t)
        return np.append(place.translation - asked.position, pin.log3(place.rotation @ asked.rotation.T))

    def rate(t, state):
        x, asked = system.at(state[:7], state[7:]), path.at(t)
        velocity, acceleration, missed = resolved_motion(x, frame, asked)
        assert not missed.any()
        jacobian = x.frame_jacobian(frame, "local_world_aligned")
        if not complete:
            acceleration = np.linalg.pinv(jacobian) @ asked.acceleration
        torque = x.feedforward(velocity, acceleration) - 3.0 * (x.velocity - velocity)
        torque -= jacobian.T @ (np.repeat([400.0, 40.0], 3) * error(x, t))
        return np.append(x.velocity, x.acceleration(torque))

    solution = solve_ivp(rate, (0.0, 1.0), np.append(q, np.zeros(7)), "DOP853", rtol=1e-9, atol=1e-11)
    end = system.at(solution.y[:7, -1], solution.y[7:, -1])
    away = np.abs(error(end, 1.0)).max()
    assert away < 1e-10 if complete else away > 1e-5
    assert np.linalg.norm(path.at(1.0).twist) > 0.1  # it moves
