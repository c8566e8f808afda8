"""What each potential is for: stiffness at the goal, one minimum, forces that are what they say; and bad input."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import (
    FrameSpring,
    FrameWrench,
    GripperSpring,
    InvalidArgumentError,
    JointForce,
    JointSpring,
    PointForce,
    Pose,
    PositionPotential,
    SingleJointSpring,
    UnknownNameError,
)
from phcontrol.mechanics.potentials import OnJoint
from phcontrol.potentials import Holding, Potential, Sum
from tests.conftest import make_system
from tests.finite_differences import derivative, relative_error
from tests.potentials.cases import gripper_spring, random_gain, random_pose, random_rotation, random_state

seeds = st.integers(0, 2**32 - 1)
axes = st.sampled_from([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
HOME = Pose(np.array([0.3, 0.1, 0.4]), np.eye(3))


def turned(x, frame, turn):
    """The goal from which the frame is turned by R_e = ``turn``, at its own place."""
    pose = x.placement(frame)
    return Pose(pose.translation, pose.rotation @ turn.T)


def matrix_along(potential, x):
    return np.array([potential.hessian_along(x, unit) for unit in np.eye(x.system.n)])


@given(seed=seeds)
def test_stiffness_at_the_goal_is_what_was_asked_for(seed):
    """In world axes for the position, in the goal's for the orientation."""
    rng = np.random.default_rng(seed)
    system = make_system("panda")
    x = random_state(system, rng)
    goal, jacobian = x.placement("panda_hand_tcp"), x.frame_jacobian("panda_hand_tcp", "local_world_aligned")
    translational, rotational = random_gain(rng, 3, 200.0), random_gain(rng, 3, 10.0)
    spring = FrameSpring("panda_hand_tcp", goal, translational_stiffness=translational, rotational_stiffness=rotational)
    world = goal.rotation @ rotational @ goal.rotation.T
    expected = jacobian[:3].T @ translational @ jacobian[:3] + jacobian[3:].T @ world @ jacobian[3:]
    assert relative_error(matrix_along(spring, x), expected) < 1e-12
    np.testing.assert_allclose(spring.gradient(x), 0.0, atol=1e-11)  # rounding times the stiffness
    assert abs(spring.energy(x)) < 1e-26  # the square of rounding, 1e-32, times the stiffness


@given(seed=seeds, angle=st.floats(1e-6, np.pi), distance=st.floats(0.0, 2.0))
def test_the_goal_is_the_only_minimum(seed, angle, distance):
    """Ψ lies between the least and the greatest that a turn by φ can cost, (μ₁ + μ₂)(1 − cos φ) of the moments of G."""
    rng = np.random.default_rng(seed)
    x = random_state(make_system("panda"), rng)
    rotational = random_gain(rng, 3, 10.0)
    axis = rng.normal(size=3)
    goal = turned(x, "panda_hand_tcp", pin.exp3(angle * axis / np.linalg.norm(axis)))
    goal = Pose(goal.translation + distance * np.array([0.0, 0.6, 0.8]), goal.rotation)
    spring = FrameSpring("panda_hand_tcp", goal, translational_stiffness=100.0, rotational_stiffness=rotational)
    stiffnesses = np.linalg.eigvalsh(rotational)
    pull = 0.5 * 100.0 * distance**2
    # aᵀK_r a (1 − cos φ) for a turn about a unit axis a: between the eigenvalues of K_r
    least, greatest = (pull + (1.0 - np.cos(angle)) * stiffness for stiffness in stiffnesses[[0, -1]])
    assert least * (1.0 - 1e-9) - 1e-15 <= spring.energy(x) <= greatest * (1.0 + 1e-9) + 1e-15
    assert spring.energy(x) > 0.0


@given(seed=seeds, axis=axes)
def test_smooth_and_finite_through_half_turns(seed, axis):
    rng = np.random.default_rng(seed)
    x = random_state(make_system("panda"), rng)
    stiffness = np.diag([8.0, 3.0, 5.0])

    def torque(angle):
        goal = turned(x, "panda_hand_tcp", pin.exp3(angle * np.array(axis)))
        return FrameSpring("panda_hand_tcp", goal, rotational_stiffness=stiffness).wrench(
            x.frame_kinematics("panda_hand_tcp")
        )[3:]

    k = float(np.array(axis) @ stiffness @ np.array(axis))
    world = x.placement("panda_hand_tcp").rotation @ np.array(axis)
    for angle in (0.3, np.pi - 1e-9, np.pi, np.pi + 1e-9, 5.0):
        np.testing.assert_allclose(torque(angle), k * np.sin(angle) * world, atol=1e-12)
    # its derivative along the turn is continuous there
    np.testing.assert_allclose(derivative(lambda h: torque(np.pi + h)), -k * world, atol=1e-8)


@given(seed=seeds)
def test_nothing_holds_along_the_free_direction(seed):
    rng = np.random.default_rng(seed)
    system, free = make_system("panda"), rng.normal(size=3)
    x, goal = random_state(system, rng), rng.normal(size=3)
    spring = FrameSpring(
        "panda_hand_tcp", goal, translational_stiffness=random_gain(rng, 3, 100.0), free_direction=free
    )
    along = Pose(goal + 0.7 * free, np.eye(3))
    assert spring.energy(x, along) == pytest.approx(spring.energy(x), rel=1e-9, abs=1e-12)
    wrench = spring.wrench(x.frame_kinematics("panda_hand_tcp"))
    assert abs(wrench[:3] @ free) < 1e-12 * max(1.0, np.abs(wrench).max()) * np.linalg.norm(free)
    across = np.cross(free, [1.0, 0.0, 0.0])
    assert spring.energy(system.at(x.position), Pose(x.placement("panda_hand_tcp").translation + across, np.eye(3))) > 0


def test_holding_is_stiff_as_before_and_smooth_beyond(pera, rng):
    """Beside a spring on the logarithm, ½k_rφ²: the same to second order at the goal, no jump at a half turn."""
    reference, normal, elbow = random_state(pera, rng), rng.normal(size=3), "elbow_roll"
    options = {"tangential_stiffness": 150.0, "rotational_stiffness": 7.0, "joint": elbow, "joint_stiffness": 3.0}
    new = Holding("tool", reference, normal, **options)
    there, n, direction = reference.placement("tool"), normal / np.linalg.norm(normal), rng.normal(size=7)
    index = pera.robot.joint_names.index(elbow)

    def by_logarithm(x):
        away = x.placement("tool").translation - there.translation
        turn = pin.log3(there.rotation.T @ x.placement("tool").rotation)
        beside = away @ away - (away @ n) ** 2
        return 0.5 * (150.0 * beside + 7.0 * turn @ turn + 3.0 * (x.position - reference.position)[index] ** 2)

    for size, agreement in ((1e-1, 1e-2), (1e-2, 1e-4), (1e-3, 1e-6)):  # they differ by a part φ²/12
        x = pera.at(reference.position + size * direction)
        assert new.energy(x) == pytest.approx(by_logarithm(x), rel=agreement)
        assert new.energy(x) != pytest.approx(by_logarithm(x), rel=agreement * 1e-3)
    np.testing.assert_array_equal(new.posture, reference.position)
    assert new.follows == ("tool", "joints")


def test_holding_leaves_out_what_is_not_stiff(pera):
    x, moved = pera.at(pera.robot.home), pera.at(pera.robot.home + 0.2)
    nothing = Holding("tool", x, [1.0, 0.0, 0.0], tangential_stiffness=0.0, rotational_stiffness=0.0)
    assert nothing.energy(moved) == 0.0
    np.testing.assert_array_equal(nothing.gradient(moved), np.zeros(7))
    assert nothing.coordinates(moved).shape == (0,)
    assert nothing.coordinate_map(moved).shape == (0, 7)
    assert nothing.lacks_minimum(pera) == "Sum() has no minimum: no spring is in it"
    only_turn = Holding("tool", x, [1.0, 0.0, 0.0], tangential_stiffness=0.0)
    assert only_turn.coordinates(moved).shape == (9,)


@given(seed=seeds, angle=st.floats(-3.0, 3.0))
def test_a_wrench_is_exact_at_its_orientation_and_falls_off_as_stated(seed, angle):
    rng = np.random.default_rng(seed)
    x = random_state(make_system("pera"), rng)
    force = rng.normal(size=6)
    pose, torque = x.placement("tool"), force[3:]
    jacobian = x.frame_jacobian("tool", "local_world_aligned")
    exact = FrameWrench("tool", force, orientation=pose.rotation)
    assert relative_error(exact.gradient(x), jacobian.T @ force) < 1e-13
    axis = torque / np.linalg.norm(torque)
    beside = np.cross(axis, [1.0, 0.0, 0.0])
    beside /= np.linalg.norm(beside)
    for turned_about, size in ((axis, np.cos(angle)), (beside, 0.5 * (1.0 + np.cos(angle)))):
        # the frame is turned by the angle from the orientation at which the torque is meant
        wrench = FrameWrench("tool", force, orientation=pin.exp3(angle * turned_about).T @ pose.rotation)
        assert wrench.wrench(x.frame_kinematics("tool"))[3:] @ axis == pytest.approx(
            size * np.linalg.norm(torque), abs=1e-12
        )
        assert relative_error(wrench.lever(x) @ wrench.force, wrench.gradient(x)) < 1e-13


def test_a_constant_torque_really_has_no_potential(pera, rng):
    """𝒥_ωᵀτ is no gradient: its derivative is not symmetric. That is why ``FrameWrench`` asks for an orientation."""
    x, torque = random_state(pera, rng), rng.normal(size=3)
    derivative_ = x.frame_jacobian_derivative("tool", "local_world_aligned")[:, 3:]
    hessian = np.einsum("kin,i->kn", derivative_, torque)
    assert np.abs(hessian - hessian.T).max() > 0.1


def test_forces_have_levers(pera, rng):
    x = random_state(pera, rng)
    for potential in (JointForce(rng.normal(size=7)), PointForce("tool", rng.normal(size=3))):
        assert relative_error(potential.lever(x) @ potential.force, potential.gradient(x)) < 1e-14


def test_the_grippers_spring_is_the_plants(pera, rng):
    x = random_state(pera, rng)
    spring = gripper_spring()
    for plant in (spring, OnJoint(spring, 3)):
        shaped = PositionPotential(plant)
        assert shaped.energy(x) == plant.energy(x.position)
        np.testing.assert_array_equal(shaped.gradient(x), plant.gradient(x.position))
        shaped.check(pera)
    (arms_own,) = make_system("pera_gripper").robot.potentials
    PositionPotential(arms_own).check(make_system("pera_gripper"))


def test_what_lacks_a_minimum_says_so(pera):
    ur5, panda = make_system("ur5"), make_system("panda")
    full = {"translational_stiffness": 100.0, "rotational_stiffness": 5.0}
    assert JointSpring(np.zeros(7), 1.0).lacks_minimum(pera) == ""
    assert FrameSpring("tool0", HOME, **full).lacks_minimum(ur5) == ""
    seven = FrameSpring("panda_hand_tcp", HOME, **full)
    assert "holds 6 of the 7 directions" in seven.lacks_minimum(panda)
    assert (seven + SingleJointSpring("panda_joint3", 0.0, 5.0)).lacks_minimum(panda) == ""
    # the last joint turns the hand, which is held already
    point = FrameSpring("tool0", [0.3, 0.1, 0.4], translational_stiffness=100.0)
    assert "holds 3 of the 6 directions" in point.lacks_minimum(ur5)
    free = FrameSpring("tool0", HOME, free_direction=[0, 0, 1], **full)
    assert "holds 5 of the 6 directions" in free.lacks_minimum(ur5)
    for force in (JointForce(np.ones(6)), PointForce("tool0", [0, 0, 1.0]), FrameWrench("tool0", [0, 0, 1.0, 0, 0, 0])):
        assert "has no minimum: no spring" in force.lacks_minimum(ur5)
        assert (JointSpring(np.zeros(6), 10.0) + force).lacks_minimum(ur5) == ""
    assert "holds 1 of the 7" in PositionPotential(OnJoint(gripper_spring(), 2)).lacks_minimum(pera)


def frame_spring(**options):
    return FrameSpring("tool", options.pop("goal", HOME), **options)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: frame_spring(), "translational_stiffness: or rotational_stiffness must be given"),
        (lambda: frame_spring(translational_stiffness=0, rotational_stiffness=None), "must be given: nothing is held"),
        (lambda: frame_spring(translational_stiffness=-1.0), "translational_stiffness: must be positive definite"),
        (lambda: frame_spring(rotational_stiffness=[1, 1, 0]), "rotational_stiffness: must be positive definite"),
        (lambda: frame_spring(rotational_stiffness=[[1, 1, 0], [0, 1, 0], [0, 0, 1]]), "must be symmetric"),
        (lambda: frame_spring(translational_stiffness=[1, 1]), "translational_stiffness: must be a scalar, a vector"),
        (lambda: frame_spring(translational_stiffness="stiff"), "translational_stiffness: must be an array"),
        (lambda: frame_spring(rotational_stiffness=np.nan), "rotational_stiffness: must be finite"),
        (lambda: frame_spring(rotational_stiffness=1, free_direction=[0, 0, 1]), "needs a translational_stiffness"),
        (lambda: frame_spring(translational_stiffness=1, free_direction=[0, 0, 0]), "free_direction: must not be zero"),
        (lambda: frame_spring(rotational_stiffness=1, goal=[0, 0, 1]), "goal: must be a pose .* but is a point"),
        (lambda: frame_spring(translational_stiffness=1, goal=[0, 1]), "goal: must be a pose .* has shape"),
        (lambda: frame_spring(translational_stiffness=1, goal=[0, np.inf, 1]), "goal: must be finite"),
        (lambda: frame_spring(translational_stiffness=1, goal=None), "goal: must be"),
        (
            lambda: frame_spring(rotational_stiffness=1, goal=Pose(np.zeros(3), 2.0 * np.eye(3))),
            r"goal.rotation: must be a rotation matrix .* but is \[\[2.0, 0.0",
        ),
        (
            lambda: frame_spring(rotational_stiffness=1, goal=Pose(np.zeros(3), np.diag([1.0, 1.0, -1.0]))),
            "goal.rotation: must be a rotation matrix .* det R = 1",
        ),
        (lambda: frame_spring(rotational_stiffness=1, goal=Pose(np.zeros(3), np.eye(2))), "goal.rotation: .*shape"),
        (lambda: frame_spring(rotational_stiffness=1, goal=2.0 * np.eye(4)), "goal: must have the last row"),
        (lambda: FrameWrench("tool", [0, 0, 0, 0, 0, 1]), "orientation: must be given with a torque"),
        (lambda: FrameWrench("tool", [0, 0, 1]), r"force: must have shape \(6,\)"),
        (lambda: FrameWrench("tool", np.ones(6), orientation=np.zeros((3, 3))), "orientation: must be a rotation"),
        (lambda: PointForce(3, [0, 1, 0]), "frame: must be a name, but is 3"),
        (lambda: SingleJointSpring(None, 0.0, 1.0), "joint: must be a name, but is None"),
        (lambda: PointForce("tool", [0, 1]), r"force: must have shape \(3,\)"),
        (lambda: JointForce(3.0), "force: must be a vector"),
        (lambda: JointSpring(0.0, 1.0), "goal: must be a vector"),
        (lambda: JointSpring([0.0, 0.0], [1.0, -1.0]), "stiffness: must be positive definite"),
        (lambda: JointSpring([0.0, 0.0], [1.0, 1.0, 1.0]), "stiffness: must be a scalar"),
        (lambda: SingleJointSpring("elbow_roll", 0.0, 0.0), "stiffness: must be > 0"),
        (lambda: Sum(JointSpring([0.0], 1.0), 3.0), "potentials: must be potentials, but one is float"),
        (lambda: PositionPotential(3.0), "spring: must have energy, gradient and tangent_stiffness, but float"),
        (lambda: Holding("tool", 1.0, [0, 0, 1]), "reference: must be a state"),
        (lambda: Holding("tool", make_system("pera").at(np.zeros(7)), [0, 0, 0]), "normal: must not be zero"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(InvalidArgumentError, match=message):
        make()


@pytest.mark.parametrize(
    ("potential", "message"),
    [
        (FrameSpring("tol", HOME, translational_stiffness=1.0), "unknown frame 'tol' of pera.*'tool'"),
        (PointForce("tol", [0, 0, 1]), "unknown frame 'tol'"),
        (JointSpring(np.zeros(7), 1.0) + FrameWrench("tol", [0, 0, 1, 0, 0, 0]), "unknown frame 'tol'"),
        (SingleJointSpring("elbow_rol", 0.0, 1.0), "unknown joint 'elbow_rol' of pera.*'elbow_roll'"),
    ],
)
def test_names_that_the_arm_has_not_are_refused(pera, potential, message):
    with pytest.raises(UnknownNameError, match=message):
        potential.check(pera)


@pytest.mark.parametrize(
    ("potential", "message"),
    [
        (JointSpring(np.zeros(6), 1.0), r"goal: must have shape \(7,\)"),
        (JointForce(np.zeros(6)), r"force: must have shape \(7,\)"),
        (PositionPotential(OnJoint(gripper_spring(), 7)), "spring: is on joint 7, but pera has joints 0 to 6"),
    ],
)
def test_what_does_not_fit_the_arm_is_refused(pera, potential, message):
    with pytest.raises(InvalidArgumentError, match=message):
        potential.check(pera)
    (JointSpring(np.zeros(7), 1.0) + JointForce(np.zeros(7)) + PointForce("tool", [0, 0, 1])).check(pera)


def test_goals_are_copied_and_taken_in_every_form(pera, rng):
    x, pose = random_state(pera, rng), random_pose(rng)
    translation, turn = pose.translation.copy(), pose.rotation.copy()
    own = Pose(translation, turn)
    homogeneous = pin.SE3(turn, translation).homogeneous
    springs = [
        FrameSpring("tool", goal, translational_stiffness=10.0, rotational_stiffness=2.0)
        for goal in (own, pin.SE3(turn, translation), homogeneous)
    ]
    expected = springs[0].gradient(x)
    translation += 1.0
    turn[:] = np.eye(3)
    homogeneous += 1.0
    for spring in springs:
        np.testing.assert_allclose(spring.gradient(x), expected, atol=1e-12)
        given_anew = spring.gradient(x, pin.SE3(pose.rotation, pose.translation))
        np.testing.assert_allclose(given_anew, expected, atol=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        springs[0].goal.translation[0] = 1.0


def test_a_potential_of_ones_own_needs_five_methods(pera, rng):
    """The base derives gradient, Hessian and what is held."""

    class Well(Potential):
        """Ψ = 1 − cos q₁."""

        def energy(self, x, goal=None):
            return float(1.0 - np.cos(x.position[0]))

        def coordinates(self, x, goal=None):
            return x.position[:1]

        def coordinate_gradient(self, x, goal=None):
            return np.sin(x.position[:1])

        def coordinate_map(self, x, goal=None):
            return np.eye(x.system.n)[:1]

        def gradient_rate(self, x, velocity, goal=None):
            return np.cos(x.position[0]) * velocity[0] * np.eye(x.system.n)[0]

    x = random_state(pera, rng)
    expected = np.sin(x.position[0]) * np.eye(7)[0]
    np.testing.assert_allclose(Well().gradient(x), expected, atol=1e-15)
    np.testing.assert_allclose(matrix_along(Well(), x), np.diag(np.cos(x.position[0]) * np.eye(7)[0]), atol=1e-15)
    assert Well().lacks_minimum(pera) == "Well holds 1 of the 7 directions in which the joints move, and no others"
    assert Well().follows == ()
    assert Well().posture is None
    Well().check(pera)


@given(seed=seeds, position=st.floats(-3.0, 3.0))
def test_the_grippers_tangent_stiffness(seed, position):
    rng = np.random.default_rng(seed)
    spring = GripperSpring(
        closing_stiffness=rng.uniform(0.1, 5.0), opening_stiffness=rng.uniform(0.1, 5.0), rest_angle=0.2, smoothing=0.05
    )
    at = np.array([position])
    expected = derivative(lambda h: spring.gradient(at + h))
    # the transition is 0.2 rad wide: a fifth derivative of up to 5·10⁴ times 1e-12
    np.testing.assert_allclose(spring.tangent_stiffness(at), expected, atol=1e-6)


def test_rotations_of_random_tests_are_rotations(rng):
    turn = random_rotation(rng)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
