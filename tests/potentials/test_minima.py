"""Where potentials are smallest, how far a frame is from there, and how their coordinates turn with a goal."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

from phcontrol import (
    FrameSpring,
    FrameWrench,
    InvalidArgumentError,
    JointForce,
    JointSpring,
    PointForce,
    Pose,
    PositionPotential,
    Potential,
    SingleJointSpring,
)
from phcontrol.mechanics.potentials import OnJoint
from phcontrol.potentials import Holding
from tests.conftest import make_system
from tests.finite_differences import derivative, relative_error
from tests.potentials.cases import gripper_spring, random_gain, random_pose, random_state


class Coordinates(Potential):
    """Ψ = ½|C q|² in the coordinates C q."""

    def __init__(self, map_):
        self.map = map_

    def energy(self, x, goal=None):
        return float(0.5 * np.sum((self.map @ x.position) ** 2))

    def coordinates(self, x, goal=None):
        return self.map @ x.position

    def coordinate_gradient(self, x, goal=None):
        return self.map @ x.position

    def coordinate_map(self, x, goal=None):
        return self.map

    def gradient_rate(self, x, velocity, goal=None, missed=None):
        return self.map.T @ (self.map @ velocity)


class Misplaced(JointSpring):
    """A spring that says it is smallest beside its goal."""

    shift = 0.0

    @property
    def posture(self):
        return self.goal + self.shift


def test_the_minimum_of_springs_and_a_force_is_where_they_balance(pera, rng):
    goal, stiffness, force = pera.robot.home, random_gain(rng, 7, 20.0), rng.normal(size=7)
    potential = JointSpring(goal, stiffness) + JointForce(force)
    expected = goal - np.linalg.solve(stiffness, force)
    for start in (goal, expected, goal + rng.uniform(-2.0, 2.0, size=7)):  # up to several of the longest steps away
        np.testing.assert_allclose(potential.minimum_near(pera, start), expected, atol=1e-12)


def test_what_is_not_held_stays_where_it_starts(pera, rng):
    start = pera.at(rng.uniform(-0.5, 0.5, size=7)).position
    index = pera.robot.joint_index("elbow_roll")
    expected = start.copy()
    expected[index] = 0.3
    found = SingleJointSpring("elbow_roll", 0.3, 5.0).minimum_near(pera, start)
    np.testing.assert_allclose(found, expected, atol=1e-14)
    np.testing.assert_array_equal(JointForce(rng.normal(size=7)).minimum_near(pera, start), start)  # it has none


@pytest.mark.parametrize("arm", ["pera", "panda", "ur5"])
def test_the_minimum_of_a_frames_spring_reaches_its_goal(arm, rng):
    system = make_system(arm)
    frame = {"pera": "tool", "panda": "panda_hand_tcp", "ur5": "tool0"}[arm]
    there = system.at(system.robot.home + 0.2)
    spring = FrameSpring(frame, there.placement(frame), translational_stiffness=200.0, rotational_stiffness=20.0)
    start = there.position + rng.uniform(-0.3, 0.3, size=system.n)
    found = system.at(spring.minimum_near(system, start))
    assert spring.energy(system.at(start)) > 0.1
    placement, goal = found.placement(frame), there.placement(frame)
    np.testing.assert_allclose(placement.translation, goal.translation, atol=1e-9)
    np.testing.assert_allclose(placement.rotation, goal.rotation, atol=1e-9)
    far = Pose(goal.translation + np.array([1.0, 0.0, -0.5]), goal.rotation)  # out of reach

    def out_of_reach(position):
        x = system.at(position)
        return spring.energy(x, far), spring.gradient(x, far)

    nearest = minimize(out_of_reach, start, jac=True, method="BFGS", options={"gtol": 1e-9, "maxiter": 2000})
    assert nearest.fun > 1.0
    assert spring.energy(system.at(spring.minimum_near(system, start, far)), far) == pytest.approx(nearest.fun)


def test_a_posture_where_it_has_a_slope_is_refused(pera):
    spring, force = Misplaced(pera.robot.home, random_gain(np.random.default_rng(1), 7, 20.0)), JointForce(np.ones(7))
    spring.check_posture(pera)
    (spring + force).check_posture(pera)  # the sum is smallest elsewhere, as it may be
    force.check_posture(pera)  # which says nothing
    spring.shift = 1e-9  # rounding
    spring.check_posture(pera)
    spring.shift = 1e-3
    slope = np.abs(spring.stiffness @ np.full(7, 1e-3)).max()
    for potential in (spring, spring + force):
        with pytest.raises(InvalidArgumentError, match=f"its gradient is up to {slope:.3g} N·m"):
            potential.check_posture(pera)


def test_coordinates_of_a_sum_turn_with_the_twist_of_the_goal(pera, rng):
    """Against a goal that moves: the coordinates change by −L times its twist, and only those that follow it."""
    x, pose, twist = random_state(pera, rng), random_pose(rng), rng.normal(size=6)
    spring = FrameSpring("tool", random_pose(rng), translational_stiffness=40.0, rotational_stiffness=3.0)
    total = JointSpring(np.zeros(7), 4.0) + spring + PointForce("tool", rng.normal(size=3)) + JointForce(np.ones(7))

    def coordinates(t):
        return total.coordinates(x, Pose(pose.translation + t * twist[:3], pin.exp3(t * twist[3:]) @ pose.rotation))

    expected = -derivative(coordinates)
    assert np.abs(expected).max() > 0.1
    assert relative_error(total.twist_map(x, pose) @ twist, expected) < 1e-9


def test_how_far_a_frame_is_counts_only_what_is_held(pera):
    x = pera.at(pera.robot.home)
    hand, free = x.placement("tool"), np.array([1.0, 2.0, -2.0]) / 3.0
    across = np.cross(free, [1.0, 0.0, 0.0])
    goal = Pose(hand.translation + 0.3 * free + 0.02 * across / np.linalg.norm(across), hand.rotation)
    turned = Pose(goal.translation, pin.exp3(0.4 * free) @ hand.rotation)
    options = {"translational_stiffness": [30.0, 20.0, 10.0], "free_direction": free}
    held = FrameSpring("tool", turned, rotational_stiffness=3.0, **options).deviation(x)
    assert held.distance == pytest.approx(0.02, rel=1e-12)
    assert held.angle == pytest.approx(0.4, rel=1e-12)
    assert str(held) == "0.02 m and 0.4 rad"
    assert str(FrameSpring("tool", turned, **options).deviation(x)) == "0.02 m"
    everything = FrameSpring("tool", turned, translational_stiffness=10.0).deviation(x)
    assert everything == (pytest.approx(np.hypot(0.3, 0.02), rel=1e-12), 0.0)
    assert FrameWrench("tool", [0, 0, 1, 0, 0, 1], orientation=turned.rotation).deviation(x) == (0.0, 0.0)


def test_what_rounding_leaves_holds_nothing_in_any_unit(rng):
    """A matrix of rank 1, in units in which its rounding errors are 1e-9 and in those in which all of it is small."""
    system = make_system("ur5")
    one = np.outer(rng.normal(size=6), rng.normal(size=6))
    for scale in (1e7, 1.0, 1e-3):
        told = Coordinates(scale * one).lacks_minimum(system)
        assert told == "Coordinates holds 1 of the 6 directions in which the joints move, and no others"
    two = one + 1e-6 * np.outer(rng.normal(size=6), rng.normal(size=6))
    assert "holds 2 of the 6 directions" in Coordinates(two).lacks_minimum(system)


def test_what_holding_does_not_say_is_200_5_and_5(pera):
    x, n = pera.at(pera.robot.home), np.array([0.0, 0.0, 1.0])
    moved = pera.at(pera.robot.home + 0.1)
    there, here = x.placement("tool"), moved.placement("tool")
    away = here.translation - there.translation
    expected = 0.5 * 200.0 * (away @ away - (away @ n) ** 2) + 0.5 * 5.0 * 0.1**2
    expected += 0.5 * 5.0 * (3.0 - np.trace(there.rotation.T @ here.rotation))
    assert Holding("tool", x, n, joint="elbow_roll").energy(moved) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("name", ["tangential_stiffness", "rotational_stiffness", "joint_stiffness"])
def test_holding_refuses_what_would_push_away(pera, name):
    for value in (-0.5, -1e-12):
        with pytest.raises(InvalidArgumentError, match=f"{name}: must be >= 0"):
            Holding("tool", pera.at(pera.robot.home), [0.0, 0.0, 1.0], **{name: value})


def test_a_spring_on_a_joint_counted_from_the_end_is_refused(pera):
    """−1 would take the last joint's place, but no joint's position: V's gradient there is of nothing."""
    with pytest.raises(InvalidArgumentError, match="spring: is on joint -1, but pera has joints 0 to 6"):
        PositionPotential(OnJoint(gripper_spring(), -1)).check(pera)


@pytest.mark.parametrize("goal", [[], 0.0, [[0.0, 0.0]]])
def test_a_goal_that_is_no_vector_is_refused(goal):
    with pytest.raises(InvalidArgumentError, match="goal: must be a vector of joint positions, but has shape"):
        JointSpring(goal, 1.0)
