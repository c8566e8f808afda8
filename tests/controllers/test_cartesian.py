"""Cartesian impedance and tracking: closed forms, step responses, singular postures, bad input."""

from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import sqrtm

from phcontrol import (
    CartesianImpedance,
    CartesianTracking,
    EnergyShaping,
    FigureOfEight,
    FrameLine,
    FrameSpring,
    IntegralAction,
    InvalidArgumentError,
    MechanicalSystem,
    MinimumJerk,
    Pose,
    Stiffness,
    UnknownNameError,
    Wrench,
    certify,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.controllers.cartesian_law import BANDWIDTH
from phcontrol.controllers.shaping import EMPTY
from phcontrol.runs.cartesian import run_cartesian
from tests.controllers.arms import arm

ARMS = ("panda", "pera", "kinova", "z1", "ur5")
LAWS = ("cartesian_impedance", "cartesian_impedance_with_tank", "cartesian_tracking")
HAND = {"translational_stiffness": [600.0, 600.0, 200.0], "rotational_stiffness": 30.0}
POSTURES = (
    (0.4, -0.385, 0.4, -1.956, 0.4, 1.868, 0.385),
    (0.0, -0.3, 0.0, -1.2, 0.0, 1.5, 0.7),
    (0.8, 0.3, -0.5, -1.5, 0.6, 2.2, -0.4),
)
"""Of the panda."""


@pytest.fixture(scope="module")
def panda():
    return arm("panda")


@pytest.fixture(scope="module")
def free(panda):
    """The panda without friction."""
    return MechanicalSystem(panda.robot, friction=None)


def pose(system, posture, frame=None):
    placement = system.at(posture).placement(frame or system.hand_frame)
    return Pose(np.array(placement.translation), np.array(placement.rotation))


def deviation(system, goal, posture):
    hand = system.at(posture).placement(system.hand_frame)
    angle = pin.log3(goal.rotation.T @ hand.rotation)
    return np.linalg.norm(hand.translation - goal.translation), np.linalg.norm(angle)


# --- what it is ----------------------------------------------------------------------------------------------


def test_torque_is_the_formula_written_out(panda, rng):
    """Energy shaping about a FrameSpring, with D_x by the other double diagonalisation: Λ = QQᵀ, K = Q K₀ Qᵀ."""
    goal, x = pose(panda, POSTURES[0]), panda.at(POSTURES[2], rng.normal(size=7))
    law = CartesianImpedance(panda, goal=goal, damping_ratio=0.6, nullspace_damping=3.0, **HAND)
    spring = FrameSpring(panda.hand_frame, goal, **HAND)
    J, M = x.frame_jacobian(panda.hand_frame, "local_world_aligned"), x.mass_matrix
    inertia = np.linalg.inv(J @ np.linalg.inv(M) @ J.T)
    R = x.placement(panda.hand_frame).rotation
    K = np.diag([600.0, 600.0, 200.0, 30.0, 30.0, 30.0])
    K[3:, 3:] = R @ K[3:, 3:] @ R.T
    half = np.linalg.cholesky(inertia)
    K0, turn = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, K).T))
    Q = half @ turn
    damping = J.T @ (1.2 * Q * np.sqrt(K0)) @ Q.T @ J + 3.0 * (M - J.T @ inertia @ J)
    expected = x.potential_gradient - spring.gradient(x) - damping @ x.velocity
    np.testing.assert_allclose(law.evaluate(0.0, x, EMPTY).torque, expected, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(law.joint_damping(0.0, x), damping, atol=1e-10 * np.abs(damping).max())


def test_all_modes_of_the_hand_have_the_damping_ratio(panda, rng):
    """Of Λẍ + D_x ẋ + K x: s = −ζω ± …, at random postures."""
    for _ in range(10):
        x = panda.at(panda.robot.random_position(rng))
        law = CartesianImpedance(panda, goal=pose(panda, x.position), damping_ratio=0.7, **HAND)
        inertia, D = np.linalg.inv(x.task_space(panda.hand_frame).mobility), law.task_damping_matrix(0.0, x)
        R = x.placement(panda.hand_frame).rotation
        K = np.diag([600.0, 600.0, 200.0, 30.0, 30.0, 30.0])
        K[3:, 3:] = R @ K[3:, 3:] @ R.T
        A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(inertia, K), -np.linalg.solve(inertia, D)]])
        values = np.linalg.eigvals(A)
        np.testing.assert_allclose(-values.real / np.abs(values), 0.7, atol=1e-6)
        assert np.linalg.eigvalsh(D)[0] > 0.0
        other = 0.7 * (sqrtm(inertia) @ sqrtm(K) + sqrtm(K) @ sqrtm(inertia))  # the formula in use elsewhere
        assert np.abs(other.real - D).max() > 1e-3 * np.abs(D).max()


@pytest.mark.parametrize("axes", ["world", "tool"])
def test_the_damping_ratio_is_that_of_the_stiffness_at_the_time(panda, rng, axes):
    """K(t) of 9 times K: ζ, and not ζ/3; asked at two times of one state, as certificates do."""
    x = panda.at(np.array(POSTURES[0]) + 0.1)
    goal = pose(panda, POSTURES[0])
    linear, turning = np.array([600.0, 600.0, 200.0]), np.array([30.0, 20.0, 10.0])
    varied = Stiffness(lambda t: (1.0 + 8.0 * t) * linear, rotational=lambda t: (1.0 + 3.0 * t) * turning, duration=1.0)
    gains = {"translational_stiffness": linear, "rotational_stiffness": turning, "axes": axes, "damping_ratio": 0.6}
    law = CartesianImpedance(panda, goal=goal, variation=varied, **gains)
    same = CartesianImpedance(panda, goal=goal, **gains)
    inertia, R = np.linalg.inv(x.task_space(panda.hand_frame).mobility), x.placement(panda.hand_frame).rotation
    v = rng.normal(size=7)
    for t in (0.0, 1.0, 0.5, 0.0):
        D = law.task_damping_matrix(t, x)
        K = np.zeros((6, 6))
        A = np.eye(3) if axes == "world" else goal.rotation
        K[:3, :3] = A @ np.diag((1.0 + 8.0 * t) * linear) @ A.T
        K[3:, 3:] = R @ np.diag((1.0 + 3.0 * t) * turning) @ R.T
        modes = np.linalg.eigvals(
            np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(inertia, K), -np.linalg.solve(inertia, D)]])
        )
        np.testing.assert_allclose(-modes.real / np.abs(modes), 0.6, atol=1e-6)
        np.testing.assert_allclose(law.damping_force(t, x, v), law.joint_damping(t, x) @ v, atol=1e-9)
    np.testing.assert_allclose(law.task_damping_matrix(0.0, x), same.task_damping_matrix(0.0, x), rtol=1e-9, atol=1e-9)


def test_a_stiffness_that_varies_for_moving_alone_leaves_that_for_turning(panda):
    """D_x at a time is that of a law with K_t of that time and the same K_r."""
    x, goal = panda.at(np.array(POSTURES[0]) + 0.1), pose(panda, POSTURES[0])
    linear, turning = np.array([600.0, 600.0, 200.0]), np.array([30.0, 20.0, 10.0])
    varied = Stiffness(lambda t: (1.0 + 8.0 * t) * linear, duration=1.0)
    law = CartesianImpedance(
        panda, goal=goal, variation=varied, translational_stiffness=linear, rotational_stiffness=turning
    )
    for t in (0.0, 0.5):
        fixed = CartesianImpedance(
            panda, goal=goal, translational_stiffness=(1.0 + 8.0 * t) * linear, rotational_stiffness=turning
        )
        np.testing.assert_allclose(
            law.task_damping_matrix(t, x), fixed.task_damping_matrix(0.0, x), rtol=1e-9, atol=1e-9
        )


def test_what_the_hand_does_not_feel_is_damped_and_nothing_else(panda, rng):
    x = panda.at(POSTURES[0])
    law = CartesianImpedance(panda, goal=pose(panda, POSTURES[0]), nullspace_damping=4.0, **HAND)
    J = x.frame_jacobian(panda.hand_frame, "local_world_aligned")
    self_motion = np.linalg.svd(J)[2][-1]
    np.testing.assert_allclose(law.damping_force(0.0, x, self_motion), 4.0 * x.mass_matrix @ self_motion, atol=1e-9)
    bare = law.changed(nullspace_damping=0.0)
    moving = np.linalg.solve(x.mass_matrix, J.T @ rng.normal(size=6))  # across it in the metric of M
    np.testing.assert_allclose(law.damping_force(0.0, x, moving), bare.damping_force(0.0, x, moving), atol=1e-9)


@pytest.mark.parametrize("form", ["coriolis", "canonical"])
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("law", LAWS)
def test_certificates(name, law, form):
    certificate = certify(make_controller(law, arm(name), interconnection=form), samples=32)
    assert certificate.verdict == ("PASSED AS DRIVEN" if law == "cartesian_tracking" else "PASSED"), str(certificate)


@pytest.mark.parametrize(
    "options",
    [
        {"axes": "tool", "translational_stiffness": [900.0, 300.0, 100.0]},
        {"task_damping": [60.0, 60.0, 40.0, 5.0, 5.0, 5.0]},
        {"wrench": [0.0, 3.0, -8.0, 0.2, 0.0, -0.1]},
        {"rotational_stiffness": None, "nullspace_damping": 6.0},
        {"posture": "spring"},
        {"posture": "tank", "variation": Stiffness(lambda t: 300.0 + 100.0 * np.sin(5.0 * t), duration=1.3)},
        {"translational_stiffness": [[500.0, 100.0, 0.0], [100.0, 400.0, 0.0], [0.0, 0.0, 300.0]]},
    ],
)
def test_certificates_of_the_options(options):
    certificate = certify(make_controller("cartesian_impedance", arm("kinova"), **options), samples=32)
    assert certificate.verdict == "PASSED", str(certificate)


class Undamped(CartesianImpedance):
    """Promises a damping that its torque leaves out."""

    def damping_force(self, t, x, velocity):
        return 0.0 * velocity


class Pulled(CartesianImpedance):
    """Its torque has a tenth more of stiffness than its promise."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        return law._replace(effort=law.effort - 0.1 * self.aim(t, x).gradient)


@pytest.mark.parametrize("wrong", [Undamped, Pulled])
def test_wrong_laws_fail(wrong):
    assert not certify(wrong.tuned(arm("ur5")), samples=16).matching_passed


# --- what it does --------------------------------------------------------------------------------------------


@pytest.mark.study
@pytest.mark.parametrize("posture", POSTURES)
def test_a_push_moves_the_hand_by_the_compliance(free, posture):
    """10 N along each axis, K⁻¹F within 1 %."""
    goal = pose(free, posture)
    law = CartesianImpedance(free, goal=goal, preferred_posture=posture, **HAND)
    for axis, stiffness in enumerate((600.0, 600.0, 200.0)):
        push = 10.0 * np.eye(6)[axis]
        log = simulate(free, law, q0=posture, duration=5.0, dt=2e-3, disturbance=Wrench(free.hand_frame, push))
        moved = free.at(log.position[-1]).placement(free.hand_frame).translation - goal.translation
        assert moved[axis] == pytest.approx(10.0 / stiffness, rel=0.01)
        assert np.abs(np.delete(moved, axis)).max() < 2e-4


@pytest.mark.study
@pytest.mark.parametrize("posture", POSTURES)
def test_step_responses_have_the_damping_ratio(free, posture):
    """Each mode pushed alone, lightly: the overshoot of its own coordinate says ζ."""
    goal, x = pose(free, posture), free.at(posture)
    law = CartesianImpedance(free, goal=goal, preferred_posture=posture, damping_ratio=0.7, **HAND)
    root = np.zeros((6, 6))
    root[:3, :3] = np.diag(np.sqrt([600.0, 600.0, 200.0]))
    root[3:, 3:] = np.sqrt(30.0) * goal.rotation
    squares, modes = np.linalg.eigh(root.T @ x.task_space(free.hand_frame).mobility @ root)
    for square, mode in zip(squares, modes.T, strict=True):
        push, frequency = 0.02 * root @ mode, np.sqrt(square)
        log = simulate(
            free, law, q0=posture, duration=2.5 * np.pi / frequency / 0.7, dt=min(1e-3, 0.02 / frequency),
            disturbance=Wrench(free.hand_frame, push),
        )  # fmt: skip
        peak = 0.0
        for position in log.position:
            hand = free.at(position).placement(free.hand_frame)
            error = np.r_[hand.translation - goal.translation, pin.log3(hand.rotation @ goal.rotation.T)]
            peak = max(peak, float(mode @ root.T @ error))
        overshoot = np.log(peak / 0.02 - 1.0)
        assert -overshoot / np.hypot(np.pi, overshoot) == pytest.approx(0.7, abs=0.01)


def test_a_wrench_is_exerted_beside_the_spring(panda):
    """At rest the hand is displaced by K⁻¹F in free motion."""
    goal = pose(panda, POSTURES[0])
    law = CartesianImpedance(panda, goal=goal, wrench=[6.0, 0.0, -4.0, 0, 0, 0], **HAND)
    rest = panda.at(law.rest_posture(0.0)).placement(panda.hand_frame).translation - goal.translation
    np.testing.assert_allclose(rest, [0.01, 0.0, -0.02], atol=1e-9)


@pytest.mark.study
def test_it_crosses_singular_postures_within_the_torque_limits(panda):
    """Commanded half a metre out of reach the arm stretches out, through σ = 10⁻³ and on."""
    start = np.array(POSTURES[0])
    here = pose(panda, start)
    far = Pose(np.array([1.5, 0.3, 0.5]), here.rotation)
    with pytest.warns(UserWarning, match="out of reach, by 0.6"):
        law = CartesianImpedance(
            panda, goal=far, translational_stiffness=45.0, rotational_stiffness=4.0, preferred_posture=start
        )
    log = simulate(panda, law, q0=start, duration=8.0, torque_limit=None)
    distances = [panda.at(position).task_space(panda.hand_frame).singularity_distance for position in log.position]
    assert min(distances) < 1e-4
    assert (np.abs(log.torque) < panda.robot.effort_limit).all()
    assert np.abs(np.diff(log.torque, axis=0)).max() < 1.0  # from one millisecond to the next [N·m]
    assert np.diff(log.storage).max() <= 1e-12
    assert deviation(panda, far, log.position[-1])[0] == pytest.approx(law.out_of_reach.distance, rel=1e-3)


@pytest.mark.study
@pytest.mark.parametrize(("period", "bound"), [(None, 1e-9), (1e-3, 1e-4)])
def test_tracking_of_a_figure_of_eight_with_a_turning_hand(panda, period, bound):
    law = CartesianTracking.tuned(panda)
    log = simulate(panda, law, q0=panda.robot.near_home(), duration=8.0, control_period=period)
    errors = [
        np.linalg.norm(
            panda.at(log.position[k]).placement(panda.hand_frame).translation - law.path.at(log.time[k]).position
        )
        for k in range(6000, 8001, 25)
    ]
    assert max(errors) <= bound
    turned = law.path.at(0.0).rotation.T @ law.path.at(0.25 * law.path.duration).rotation
    assert np.linalg.norm(pin.log3(turned)) > 0.1


@pytest.mark.study
@pytest.mark.parametrize("moving", [False, True])
def test_an_unknown_load_leaves_no_error_of_the_task_with_integral_action(moving):
    """5 N and 0.5 N·m on the hand of a UR5; energy shaping about the same spring stays K⁻¹F away.

    The self-motion of a redundant arm must be held beside it, or the integral goes on with it for ever.
    """
    system = arm("ur5")
    start = system.robot.near_home()
    goal = pose(system, start)
    spring = FrameSpring(system.hand_frame, goal, translational_stiffness=300.0, rotational_stiffness=10.0)
    options = {"potential": spring}
    if moving:
        options["reference"] = FigureOfEight(system.hand_frame, (goal.translation, goal.rotation), 0.06, 0.04, 6.0)
    load = Wrench(system.hand_frame, [0.0, 3.0, -4.0, 0.0, 0.0, 0.5])
    errors = {}
    for kind, gains in ((EnergyShaping, {}), (IntegralAction, {"integral_compliance": 1.0})):
        law = kind.tuned(system, **options, **gains)
        log = simulate(system, law, q0=start, duration=15.0, dt=2e-3, disturbance=load, torque_limit=None)
        errors[kind] = max(
            np.linalg.norm(
                system.at(log.position[k]).placement(system.hand_frame).translation
                - (options["reference"].at(log.time[k]).position if moving else goal.translation)
            )
            for k in range(len(log) - 500, len(log), 25)
        )
    assert errors[EnergyShaping] > 1e-2
    assert errors[IntegralAction] < errors[EnergyShaping] / 50.0  # its slow modes still fade
    if not moving:  # and where they have faded nothing is left: with ξ = f_e the goal itself is the equilibrium
        x = system.at(start)
        force = x.frame_jacobian(system.hand_frame, "local_world_aligned").T @ [0.0, 3.0, -4.0, 0.0, 0.0, 0.5]
        command = law.evaluate(0.0, x, np.concatenate([np.zeros(6), force]))
        np.testing.assert_allclose(x.acceleration(command.torque, force), 0.0, atol=1e-9)
        np.testing.assert_allclose(command.state_rate, 0.0, atol=1e-12)


@pytest.mark.parametrize("path", [None, "line", "file"])
def test_runs_of_the_command_line(tmp_path, path):
    """A push of 10 N at 200 N/m leaves 50 mm; a path is followed, from a file too, and all is written."""
    system, push = arm("panda"), [0.0, 0.0, -10.0] if path is None else None
    name = "cartesian_impedance" if path is None else "cartesian_tracking"
    if path == "file":
        path = tmp_path / "path.csv"
        first = pose(system, system.robot.near_home()).translation
        rows = [[t, first[0], first[1] + 0.05 * (1.0 - np.cos(np.pi * t / 2.0)), first[2]] for t in (0, 0.5, 1, 1.5, 2)]
        path.write_text("\n".join(",".join(map(str, row)) for row in rows))
    stiffness = [600.0, 600.0, 200.0] if path else [600.0, 600.0, 200.0, 30.0, 30.0, 30.0]
    result = run_cartesian(
        system, controller=name, stiffness=stiffness, push=push, path=str(path), duration=2.5, samples=8, dt=2e-3
    )
    assert result.certificate.passed, str(result.certificate)
    if path is None:
        assert result.final_error == pytest.approx(0.05, rel=0.01)
        assert "50" in result.outcome
    else:
        errors = np.linalg.norm(result.hand_errors[:, :3], axis=1)
        if path == "line":
            assert errors.max() < 1e-5
        else:  # a spline through five points does not start at rest, as the arm does: what that costs fades
            assert errors.max() < 1e-3
            assert errors[-1] < 0.3 * errors.max()
    assert [file.name for file in result.write(tmp_path)] == ["log.npz", "certificate.json", "hand.png"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stiffness": [1.0, 2.0]}, "three numbers"),
        ({"push": [1.0]}, "x,y,z"),
        ({"controller": "energy_shaping"}, "no hand on a spring"),
    ],
)
def test_runs_refuse_bad_input(options, message):
    with pytest.raises(InvalidArgumentError, match=message):
        run_cartesian(arm("panda"), **options)


# --- what is refused -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"frame": "hnad"}, UnknownNameError, "hnad"),
        ({"translational_stiffness": [600.0, -600.0, 200.0]}, InvalidArgumentError, "positive definite"),
        ({"translational_stiffness": [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}, InvalidArgumentError,
         "smallest eigenvalue"),
        ({"translational_stiffness": [600.0, 600.0, 200.0, 30.0, 30.0, 30.0]}, InvalidArgumentError,
         "three numbers, but are six: give three each"),
        ({"rotational_stiffness": [1.0, 2.0]}, InvalidArgumentError, "vector of length 3"),
        ({"goal": np.diag([1.0, 1.0, 1.1, 1.0])}, InvalidArgumentError, "rotation matrix"),
        ({"goal": [0.4, 0.0, 0.5]}, InvalidArgumentError, "must be a pose for a rotational_stiffness"),
        ({"goal": None}, InvalidArgumentError, "must be given, or a reference"),
        ({"damping_ratio": 0.0}, InvalidArgumentError, "damping_ratio"),
        ({"damping_ratio": -0.7}, InvalidArgumentError, "damping_ratio"),
        ({"task_damping": [1.0, 1.0, 1.0]}, InvalidArgumentError, "length 6"),
        ({"task_damping": -1.0}, InvalidArgumentError, "positive definite"),
        ({"nullspace_damping": -1.0}, InvalidArgumentError, "nullspace_damping"),
        ({"axes": "hand"}, UnknownNameError, "tool"),
        ({"posture": "springs"}, UnknownNameError, "spring"),
        ({"posture": "tank"}, InvalidArgumentError, "preferred_posture"),
        ({"posture": "tank", "preferred_posture": POSTURES[0]}, InvalidArgumentError, "posture_stiffness"),
        ({"wrench": [1.0, 2.0, 3.0]}, InvalidArgumentError, "wrench"),
        ({"variation": 300.0}, InvalidArgumentError, "a function of time"),
        ({"rotational_stiffness": None, "wrench": [0, 0, 0, 1.0, 0, 0]}, InvalidArgumentError, "torque"),
    ],
)  # fmt: skip
def test_bad_input_is_refused(panda, options, error, message):
    arguments = {"goal": pose(panda, POSTURES[0]), **HAND} | options
    with pytest.raises(error, match=message):
        CartesianImpedance(panda, **arguments)


def test_paths_that_do_not_fit_are_refused(panda):
    start, end = pose(panda, POSTURES[0]), pose(panda, POSTURES[1])
    line = FrameLine(panda.hand_frame, start, end, 2.0)
    point = FrameLine(panda.hand_frame, start.translation, end.translation, 2.0)
    for options, message in (
        ({"path": line, "frame": "panda_hand"}, "must be that of the path"),
        ({"path": point, **HAND}, "leaves the orientation free"),
        ({"path": line, "reference": line, **HAND}, "give path alone"),
        ({"path": line, "axes": "tool", **HAND}, "goal at rest"),
        ({"path": line, "posture": "spring", "preferred_posture": POSTURES[0], "posture_stiffness": 1.0, **HAND},
         "use posture='tank'"),
    ):  # fmt: skip
        with pytest.raises(InvalidArgumentError, match=message):
            CartesianTracking(panda, **({"translational_stiffness": 300.0} | options))
    joints = MinimumJerk.within_limits(panda.robot, panda.robot.home, POSTURES[0])
    with pytest.raises(InvalidArgumentError, match="path of a frame"):
        CartesianImpedance(panda, reference=joints, **HAND)


@pytest.mark.parametrize("law", ["cartesian", "shaping"])
def test_a_path_of_points_does_not_go_with_a_spring_that_turns(panda, law):
    """What the path leaves free would be turned to the axes of the world; with a free orientation it is followed."""
    start, end = pose(panda, POSTURES[0]), pose(panda, POSTURES[1])
    path = FrameLine(panda.hand_frame, start.translation, end.translation, 2.0)

    def made(stiffness):
        if law == "cartesian":
            held = {"translational_stiffness": 300.0, "rotational_stiffness": stiffness}
            return CartesianImpedance(panda, reference=path, **held)
        spring = FrameSpring(panda.hand_frame, start, translational_stiffness=300.0, rotational_stiffness=stiffness)
        return EnergyShaping.tuned(panda, potential=spring, reference=path)

    with pytest.raises(InvalidArgumentError, match=r"^reference: leaves the orientation of '.*' free"):
        made(10.0)
    assert made(None).reference is path


@pytest.mark.parametrize("frame", ["universe", "panda_link0", "panda_link1", "panda_link2"])
def test_frames_that_do_not_move_are_refused(panda, frame):
    for make in (
        lambda: CartesianImpedance(panda, frame=frame, goal=np.eye(4), translational_stiffness=300.0),
        lambda: CartesianImpedance.tuned(panda, frame=frame),
    ):
        with pytest.raises(InvalidArgumentError, match=f"^frame: must be one whose origin .* but '{frame}' stays"):
            make()


def test_a_frame_that_few_joints_move_has_no_rotational_stiffness(panda):
    with pytest.raises(InvalidArgumentError, match="^frame: 'panda_link4' is moved by 4 joints"):
        CartesianImpedance(panda, frame="panda_link4", goal=np.eye(4), **HAND)
    assert CartesianImpedance.tuned(panda, frame="panda_link4").rotational_stiffness is None


def test_points_are_goals_of_tuned_laws_too(panda):
    point = pose(panda, POSTURES[0]).translation
    for law in (
        CartesianImpedance.tuned(panda, point),
        CartesianImpedance.tuned(panda, point, rotational_stiffness=None),
        make_controller("cartesian_impedance", panda, point),
    ):
        assert law.rotational_stiffness is None
        assert law.out_of_reach.distance < 1e-6
        np.testing.assert_array_equal(law.goal.translation, point)
    path = FrameLine(panda.hand_frame, point, point + 0.1, 2.0)
    assert CartesianImpedance.tuned(panda, reference=path).rotational_stiffness is None


def small_arm(tmp_path, joints):
    """An arm in a plane, every joint about y."""
    links = [
        f'<link name="l{k}"><inertial><mass value="1"/><origin xyz="0.1 0 0.1"/>'
        '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for k in range(joints + 1)
    ]
    hinges = [
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="0 0 0.3"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="100" velocity="5"/></joint>'
        for k in range(joints)
    ]
    tool = (
        f'<link name="tool"/><joint name="jt" type="fixed"><parent link="l{joints}"/><child link="tool"/>'
        '<origin xyz="0.1 0 0.3"/></joint>'
    )
    file = tmp_path / "arm.urdf"
    file.write_text(f'<robot name="small">{"".join(links + hinges)}{tool}</robot>')
    return MechanicalSystem(load_robot(str(file)))


def test_three_numbers_for_three_joints_are_refused(tmp_path):
    """The constructor's point, and a posture of other laws: which, is not guessed."""
    system = small_arm(tmp_path, 3)
    with pytest.raises(InvalidArgumentError, match="^goal: may be a point or a posture"):
        CartesianImpedance.tuned(system, [0.3, 0.1, 0.6])
    with pytest.raises(InvalidArgumentError, match="^system: has 3 joints, but cartesian_impedance needs at least 6"):
        make_controller("cartesian_impedance", system, [0.3, 0.1, 0.6])
    goal = pose(system, [0.3, 0.4, 0.5])
    np.testing.assert_array_equal(CartesianImpedance.tuned(system, goal).goal.translation, goal.translation)


def test_an_arm_of_one_joint(tmp_path):
    """Its Jacobian has one column, and its hand is on a spring along its circle."""
    system = small_arm(tmp_path, 1)
    x = system.at([0.3], [0.7])
    assert x.frame_kinematics("tool").jacobian.shape == x.frame_jacobian("tool", "world").shape == (6, 1)
    law = CartesianImpedance.tuned(system, posture="tank")
    assert certify(law, samples=16).verdict == "PASSED"


def test_a_goal_out_of_reach_says_by_how_much(panda):
    """A point 3 m off along x from the shoulder's axis: what is left is 3 m less the length of the arm."""
    with pytest.warns(UserWarning, match="out of reach, by") as caught:
        law = CartesianImpedance(panda, goal=[3.0, 0.0, 0.333], translational_stiffness=100.0)
    assert "as near as its spring lets it" in str(caught[0].message)
    reach = 3.0 - law.out_of_reach.distance
    rest = panda.at(law.rest_posture(0.0))
    assert rest.task_space(panda.hand_frame, 3).singularity_distance < 1e-3  # stretched
    assert np.linalg.norm(rest.placement(panda.hand_frame).translation - [0.0, 0.0, 0.333]) == pytest.approx(
        reach, 1e-3
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        CartesianImpedance(panda, goal=pose(panda, POSTURES[2]), **HAND)


@pytest.mark.parametrize("desired", [{}, {"bandwidth": 3.0}])
def test_the_default_stiffness_suits_the_hands_inertia(panda, desired):
    """A mass on each spring, the harmonic mean of those that the hand has in three directions, swings at ω."""
    law = make_controller("cartesian_impedance", panda, **desired)
    x = panda.at(panda.robot.near_home())
    jacobian = x.frame_jacobian(panda.hand_frame, "local_world_aligned")
    masses = [1.0 / (axis @ np.linalg.solve(x.mass_matrix, axis)) for axis in jacobian[:3]]
    expected = desired.get("bandwidth", BANDWIDTH) ** 2 * 3.0 / np.sum(1.0 / np.array(masses))
    np.testing.assert_allclose(law.translational_stiffness, expected * np.eye(3), rtol=1e-9)


def test_a_law_that_is_led_has_no_goal_that_it_misses(panda):
    path = FrameLine(panda.hand_frame, start := pose(panda, POSTURES[0]).translation, start + 0.1, 2.0)
    law = CartesianImpedance.tuned(panda, reference=path)
    assert tuple(law.out_of_reach) == tuple(law.pull_off) == (0.0, 0.0)


@pytest.mark.parametrize(("frame", "turns"), [("panda_link5", False), ("panda_link6", True)])
def test_a_frame_that_five_joints_move_is_left_free_to_turn(panda, frame, turns):
    """Six are needed to turn it any way: the rank of the Jacobian of its turning and moving at a posture at random."""
    x = panda.at(POSTURES[0])
    assert (np.linalg.matrix_rank(x.frame_jacobian(frame, "local")) == 6) == turns
    law = CartesianImpedance.tuned(panda, frame=frame)
    assert (law.rotational_stiffness is not None) == turns
