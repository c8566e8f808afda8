"""Every potential on every kind of arm, against differences of its energy, coordinates and gradient.

Fourth-order differences with a step of 1e-3 leave step⁴ = 1e-12 times a fifth derivative, which for joints that turn at
a few rad/s and stiffnesses that are some ten times the gradient is below 1e-8 of the larger of 1 and the quantity.
"""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import numpy as np
import pytest

import phcontrol.mechanics.pose
import phcontrol.potentials
from phcontrol import FrameSpring, JointForce, JointSpring, SingleJointSpring
from phcontrol.potentials import Sum
from tests.conftest import make_system
from tests.finite_differences import gradient, relative_error
from tests.potentials.cases import (
    FRAMES,
    KINDS,
    Motion,
    frame_spring,
    joint_spring,
    point_force,
    random_pose,
    random_state,
    rate_error,
)

DIFFERENCES = 1e-8
EXACT = 1e-12  # relative: two orders of the same products
STATES = 3

every = pytest.mark.parametrize(("arm", "kind"), [(arm, kind) for arm in FRAMES for kind in KINDS])
every_arm = pytest.mark.parametrize("arm", list(FRAMES))


def states(arm, kind, rng):
    system = make_system(arm)
    for _ in range(STATES):
        yield KINDS[kind](system, FRAMES[arm], rng), random_state(system, rng)


def motions(arm, kind, rng):
    """A potential with each kind of goal that it follows."""
    for potential, x in states(arm, kind, rng):
        start = x.position + rng.uniform(-2.0, 2.0, size=x.system.n)  # never at a half turn, where a spring jumps
        motion = Motion(x, FRAMES[arm], random_pose(rng), start, rng)
        for goal_kind in potential.follows:
            yield potential, motion, goal_kind


@every
def test_gradient_is_the_derivative_of_the_energy(arm, kind, rng):
    for potential, x in states(arm, kind, rng):
        expected = gradient(lambda q, p=potential, s=x.system: np.array(p.energy(s.at(q))), x.position)
        assert relative_error(potential.gradient(x), expected) < DIFFERENCES


@every
def test_coordinates_give_the_gradient_and_change_by_the_map(arm, kind, rng):
    for potential, x in states(arm, kind, rng):
        map_ = potential.coordinate_map(x)
        map_ = np.eye(x.system.n) if map_ is None else map_
        assert relative_error(map_.T @ potential.coordinate_gradient(x), potential.gradient(x)) < EXACT
        along = Motion(x, FRAMES[arm], random_pose(rng), x.position, rng)
        rate = rate_error(map_ @ x.velocity, lambda t, p=potential, m=along: p.coordinates(m.at(t)))
        assert rate < DIFFERENCES


@every
def test_gradient_rate_along_a_motion_with_the_goal_at_rest(arm, kind, rng):
    for potential, x in states(arm, kind, rng):
        along = Motion(x, FRAMES[arm], random_pose(rng), x.position, rng)
        rate = potential.gradient_rate(x, x.velocity)
        assert rate_error(rate, lambda t, p=potential, m=along: p.gradient(m.at(t))) < DIFFERENCES


@every
def test_along_a_goal_that_moves_everything_changes_by_the_velocity_error(arm, kind, rng):
    for potential, motion, goal in motions(arm, kind, rng):
        now, error = motion.goal(0.0, goal), motion.error_velocity

        def at(quantity, m=motion, g=goal):
            return lambda t: quantity(m.at(t), m.goal(t, g))

        rate = potential.gradient_rate(motion.x, error, now)
        assert rate_error(rate, at(potential.gradient)) < DIFFERENCES
        if isinstance(potential, Sum):  # the terms that do not follow are at rest, and change by q̇
            continue
        map_ = potential.coordinate_map(motion.x, now)
        coordinate_rate = error if map_ is None else map_ @ error
        assert rate_error(coordinate_rate, at(potential.coordinates)) < DIFFERENCES
        power = potential.gradient(motion.x, now) @ error
        assert rate_error(power, at(lambda x, g, p=potential: np.array(p.energy(x, g)))) < DIFFERENCES
        assert relative_error(power, potential.coordinate_gradient(motion.x, now) @ coordinate_rate) < EXACT


@every
def test_hessian_is_symmetric_and_that_of_the_energy(arm, kind, rng):
    for potential, x in states(arm, kind, rng):
        hessian = np.array([potential.hessian_along(x, unit) for unit in np.eye(x.system.n)])
        assert relative_error(hessian, hessian.T) < EXACT
        expected = gradient(lambda q, p=potential, s=x.system: p.gradient(s.at(q)), x.position)
        assert relative_error(hessian, expected) < DIFFERENCES


@every_arm
def test_a_wrong_sign_or_a_wrong_axis_would_be_seen(arm, rng):
    """The torque of a frame's spring with its sign reversed, or in the frame's axes instead of the world's."""
    system, frame = make_system(arm), FRAMES[arm]
    spring, x = frame_spring(system, frame, rng), random_state(system, rng)
    expected = gradient(lambda q: np.array(spring.energy(system.at(q))), x.position)
    kinematics = x.frame_kinematics(frame)
    force, torque = np.split(spring.wrench(kinematics), 2)
    for wrong in (-torque, kinematics.rotation.T @ torque):
        gradient_of_wrong = kinematics.jacobian.T @ np.concatenate([force, wrong])
        assert relative_error(gradient_of_wrong, expected) > 1e-3


@every_arm
def test_what_turns_with_the_arm_and_what_with_the_goal_both_count(arm, rng):
    """Without 𝒥̇, or without the turning of the goal, the rate of the gradient is another."""
    system = make_system(arm)
    spring, x = frame_spring(system, FRAMES[arm], rng), random_state(system, rng)
    motion = Motion(x, FRAMES[arm], random_pose(rng), x.position, rng)
    goal = motion.goal(0.0, FRAMES[arm])

    def moved(t):
        return spring.gradient(motion.at(t), motion.goal(t, FRAMES[arm]))

    assert rate_error(spring.gradient_rate(x, motion.error_velocity, goal), moved) < DIFFERENCES
    resting = system.at(x.position)  # turns nothing
    assert rate_error(spring.gradient_rate(resting, motion.error_velocity, goal), moved) > 1e-3
    assert rate_error(spring.gradient_rate(x, x.velocity, goal), moved) > 1e-3


@every_arm
def test_a_sum_is_the_sum_of_its_parts(arm, rng):
    system, frame = make_system(arm), FRAMES[arm]
    parts = [make(system, frame, rng) for make in KINDS.values()]
    total, x = Sum(*parts), random_state(system, rng)
    velocity = rng.normal(size=system.n)
    assert total.energy(x) == pytest.approx(sum(part.energy(x) for part in parts), rel=1e-12)
    for quantity in (
        lambda p: p.gradient(x),
        lambda p: p.gradient_rate(x, velocity),
        lambda p: p.hessian_along(x, velocity),
    ):
        assert relative_error(quantity(total), sum(quantity(part) for part in parts)) < EXACT
    np.testing.assert_array_equal(total.coordinates(x), np.concatenate([part.coordinates(x) for part in parts]))


def test_sums_are_flat_and_keep_what_holding_knows(pera, rng):
    joint, frame, force = (make(pera, "tool", rng) for make in (joint_spring, frame_spring, point_force))
    held = KINDS["holding"](pera, "tool", rng)
    for total in ((joint + frame) + force, joint + (frame + force)):
        assert total.potentials == (joint, frame, force)
    both = frame + held
    assert both.potentials == (frame, held)
    np.testing.assert_array_equal(both.posture, held.posture)
    np.testing.assert_array_equal((frame + joint + held).posture, joint.goal)
    assert (frame + force).posture is None
    with pytest.raises(TypeError):
        frame + 1.0


def test_a_goal_goes_to_the_terms_that_follow_its_kind(pera, rng):
    x, pose, position = random_state(pera, rng), random_pose(rng), pera.robot.random_position(rng)
    tool, joint = frame_spring(pera, "tool", rng), joint_spring(pera, "tool", rng)
    elbow = FrameSpring("forearm", random_pose(rng), translational_stiffness=30.0)
    gripper = KINDS["position_potential"](pera, "tool", rng)
    total = gripper + joint + tool + elbow
    assert total.follows == ("tool", "joints")
    assert total.energy(x, pose) == pytest.approx(
        gripper.energy(x) + joint.energy(x) + tool.energy(x, pose) + elbow.energy(x), rel=1e-12
    )
    np.testing.assert_allclose(
        total.gradient(x, position),
        gripper.gradient(x) + joint.gradient(x, position) + tool.gradient(x) + elbow.gradient(x),
        rtol=1e-12,
    )
    assert (elbow + tool).follows == ("forearm",)
    assert (gripper + gripper).follows == ()


def test_continuous_joints_wrap_in_springs_and_not_in_forces():
    system = make_system("kinova")
    turning = int(np.argmax(system.robot.continuous))
    goal = np.zeros(system.n)
    x = system.at(2.0 * np.pi * np.eye(system.n)[turning] + 0.1)
    np.testing.assert_allclose(JointSpring(goal, 3.0).gradient(x), np.full(system.n, 0.3), atol=1e-12)
    single = SingleJointSpring(system.robot.joint_names[turning], 0.0, 3.0)
    assert single.energy(x) == pytest.approx(0.5 * 3.0 * 0.01, rel=1e-12)
    force = JointForce(np.eye(system.n)[turning])
    assert force.energy(x) == pytest.approx(2.0 * np.pi + 0.1, rel=1e-12)
    assert force.energy(x, goal + 0.1) == pytest.approx(2.0 * np.pi, rel=1e-12)


@every_arm
def test_kinematics_of_a_frame_are_computed_once_and_stay(arm, rng):
    system, frame = make_system(arm), FRAMES[arm]
    first, second = random_state(system, rng), random_state(system, rng)
    poses = [x.placement(frame) for x in (first, second)]
    found = [x.frame_kinematics(frame) for x in (first, second)]
    for pose, kinematics in zip(poses, found, strict=True):  # both went through the same workspace
        np.testing.assert_allclose(kinematics.translation, pose.translation, atol=1e-14)
        np.testing.assert_allclose(kinematics.rotation, pose.rotation, atol=1e-14)
    second.frame_kinematics_rate(frame)
    first.frame_kinematics_rate(frame)
    for x in (first, second):
        kinematics, pose = x.frame_kinematics(frame), x.placement(frame)
        np.testing.assert_allclose(kinematics.translation, pose.translation, atol=1e-14)
        np.testing.assert_allclose(kinematics.rotation, pose.rotation, atol=1e-14)
        aligned = x.frame_jacobian(frame, "local_world_aligned")
        np.testing.assert_allclose(kinematics.jacobian, aligned, atol=1e-14)
        rate = x.frame_jacobian_rate(frame, "local_world_aligned")
        np.testing.assert_allclose(x.frame_kinematics_rate(frame), rate, atol=1e-13)
        assert x.frame_kinematics(frame) is kinematics
        assert x.frame_kinematics_rate(frame) is x.frame_kinematics_rate(frame)


MODULES = [module.name for module in pkgutil.iter_modules(phcontrol.potentials.__path__, "phcontrol.potentials.")]


@pytest.mark.parametrize("module", [*MODULES, "phcontrol.mechanics.pose"])
def test_examples_in_docstrings_run_as_printed(module):
    loaded = importlib.import_module(module)
    result = doctest.testmod(loaded)
    assert result.failed == 0
    public = [name for name in phcontrol.potentials.__all__ if name not in ("Goal", "Potential")]
    classes = [name for name in public if getattr(phcontrol.potentials, name).__module__ == module]
    assert all(">>>" in getattr(loaded, name).__doc__ for name in classes)
