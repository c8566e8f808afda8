"""Live goals: smooth whenever a change comes, within limits, and never a jump of H_d."""

from __future__ import annotations

import re
import threading
import warnings

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phcontrol import (
    After,
    CartesianImpedance,
    CartesianTracking,
    ControlLoop,
    EnergyShaping,
    EventSchedule,
    ForceFeedback,
    InvalidArgumentError,
    MechanicalSystem,
    Phase,
    PHControlError,
    Pose,
    UnknownNameError,
    compile_law,
    load_robot,
    simulate,
)
from phcontrol.potentials import FrameSpring
from phcontrol.setpoints import LiveFramePath, LiveTrajectory, LiveValue, Setpoint
from phcontrol.setpoints.live_parts import live_parts
from tests.controllers.arms import arm

ARM = MechanicalSystem(load_robot("pera_shoulder_elbow"))
FRAME = "panda_hand_tcp"

times = st.lists(st.floats(0.0, 3.0), min_size=1, max_size=12).map(sorted)
numbers = st.floats(-1.0, 1.0).map(lambda value: round(value, 3))


def turned(angles) -> np.ndarray:
    return pin.rpy.rpyToMatrix(*angles)


def path_of(asked, **limits) -> LiveFramePath:
    """A path after changes (time, position, angles)."""
    path = LiveFramePath(FRAME, (np.zeros(3), np.eye(3)), **limits)
    for t, position, angles in asked:
        path.request((position, turned(angles)))
        path.advance(t)
    path.advance(max(path.duration, asked[-1][0]) + 1.0)  # what waited is taken up now
    return path


changes = times.flatmap(
    lambda found: st.tuples(
        *[st.tuples(st.just(t), st.tuples(*[numbers] * 3), st.tuples(*[numbers] * 3)) for t in found]
    )
)


@given(changes)
@settings(max_examples=60, deadline=None)
def test_a_path_is_smooth_and_keeps_its_limits(asked):
    """Twist and acceleration are the derivatives of the pose, by differences, and the speeds are kept everywhere."""
    path, step = path_of(asked, speed=0.3, turning_speed=0.8), 1e-4
    for t in np.linspace(-0.1, path.duration + 0.1, 40):
        here, before, after = path.at(t), path.at(t - step), path.at(t + step)
        speed = (after.position - before.position) / (2.0 * step)
        spin = pin.log3(after.rotation @ before.rotation.T) / (2.0 * step)
        np.testing.assert_allclose(here.twist, np.concatenate([speed, spin]), atol=2e-5)
        np.testing.assert_allclose(
            here.acceleration, (after.twist - before.twist) / (2.0 * step), atol=2e-2
        )  # the jerk over a step
        assert np.linalg.norm(here.twist[:3]) <= 0.3 * (1.0 + 1e-9)
        assert np.linalg.norm(here.twist[3:]) <= 0.8 * (1.0 + 1e-9)
        assert np.linalg.norm(here.acceleration[:3]) <= 4.0 * 0.3 * (1.0 + 1e-9)
        assert np.linalg.norm(here.acceleration[3:]) <= 4.0 * 0.8 + 0.5 * 0.8**2 + 1e-9
    goal, end = path.goal, path.at(path.duration + 10.0)
    np.testing.assert_allclose(end.position, goal.position, atol=1e-12)
    np.testing.assert_allclose(end.rotation, goal.rotation, atol=1e-12)


def test_a_jump_would_be_seen():
    """The same differences on a path that is stepped: what the property test must not pass."""
    path = path_of([(1.0, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))])
    stepped = path.at(1.0 + path.duration).position - path.at(1.0).position
    assert np.linalg.norm(stepped) / 2e-4 > 100.0


@given(changes)
@settings(max_examples=60, deadline=None)
def test_what_has_been_does_not_change(asked):
    """at(t) up to the last advance is the same, whatever is asked for later."""
    path, seen = LiveFramePath(FRAME, (np.zeros(3), np.eye(3))), []
    for t, position, angles in asked:
        path.request((position, turned(angles)))
        path.advance(t)
        seen += [(moment, path.at(moment)) for moment in np.linspace(0.0, t, 5)]
    for moment, reference in seen:
        for before, now in zip(reference, path.at(moment), strict=True):
            np.testing.assert_array_equal(before, now)


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(10.0, 2000.0)), min_size=1, max_size=15))
@settings(max_examples=200, deadline=None)
def test_values_stay_between_what_was_asked_for(asked):
    """A stiffness between positive ones stays positive; a small change in the middle of a large one was the trap."""
    value = LiveValue(1000.0, rate=500.0)
    for t, goal in sorted(asked):
        value.request(goal)
        value.advance(t)
    course = [float(value(t)) for t in np.linspace(0.0, value.duration, 300)]
    low, high = (f([1000.0, *(goal for _, goal in asked)]) for f in (min, max))
    assert low - 1e-9 <= min(course)
    assert max(course) <= high + 1e-9
    rates = np.abs(np.diff(course)) / max(value.duration / 299, 1e-9)
    assert rates.max(initial=0.0) <= (500.0 * (1.0 + 1e-6) if value.duration else np.inf)


@pytest.mark.parametrize("law", [EnergyShaping, ForceFeedback])
@pytest.mark.parametrize("period", [None, 1e-3])
def test_stored_energy_never_jumps_when_goals_are_changed(law, period):
    """H_d falls while five goals are asked for on the way; the same goals as steps raise it."""
    rng, goal = np.random.default_rng(3), LiveTrajectory(ARM.robot)
    setpoint = Setpoint(goal=goal)
    postures = [ARM.robot.random_position(rng, margin=0.3) for _ in range(5)]
    for k, posture in enumerate(postures):
        setpoint.change(goal=posture, at=0.3 * k)
    start = ARM.robot.home + 0.05
    log = simulate(
        ARM, law.tuned(ARM, reference=goal), duration=8.0, dt=1e-3, q0=start, setpoint=setpoint, control_period=period,
        torque_limit=None,
    )  # fmt: skip
    assert np.diff(log.storage).max() <= (1e-9 if period is None else 1e-4) * log.storage[0]
    assert goal.has_arrived
    np.testing.assert_allclose(log.position[-1], postures[-1], atol=1e-3)
    stepped = law.tuned(ARM, goal=postures[0])
    assert stepped.storage(0.0, ARM.at(start), np.zeros(stepped.state_size)) > 10.0 * log.storage[0]


def test_a_frame_follows_a_live_pose():
    """The hand of a panda, sent elsewhere twice before it has arrived."""
    panda = MechanicalSystem(load_robot("panda"))
    home = panda.at(panda.robot.home).placement(FRAME)
    goal = LiveFramePath(FRAME, home)
    spring = FrameSpring(FRAME, home, translational_stiffness=600.0, rotational_stiffness=30.0)
    law = EnergyShaping.tuned(panda, potential=spring, reference=goal)
    setpoint = Setpoint(goal=goal)
    for at, shift, angle in ((0.2, (0.1, 0.1, 0.0), 0.3), (0.5, (0.0, -0.1, 0.1), -0.4), (0.8, (0.05, 0.0, -0.1), 0.2)):
        setpoint.change(goal=(home.translation + shift, home.rotation @ pin.exp3(np.array([0.0, angle, 0.0]))), at=at)
    log = simulate(panda, law, duration=3.0, dt=1e-3, setpoint=setpoint)
    for k in range(0, len(log), 50):
        reference, here = goal.at(log.time[k]), panda.at(log.position[k]).placement(FRAME)
        assert np.abs(here.translation - reference.position).max() < 1e-6
    np.testing.assert_allclose(here.translation, home.translation + np.array([0.05, 0.0, -0.1]), atol=1e-6)


def test_a_loop_is_changed_from_another_thread():
    """A thread asks for a thousand goals while the loop runs; every torque is finite and the last goal is reached."""
    goal = LiveTrajectory(ARM.robot)
    law = EnergyShaping.tuned(ARM, reference=goal)
    setpoint = Setpoint(goal=goal)
    clock = iter(np.arange(0.0, 1e6, 5e-4))
    loop = ControlLoop(ARM, law, 1e-3, setpoint=setpoint, start_time=0.0, clock=lambda: float(next(clock)))
    rng, home = np.random.default_rng(0), ARM.robot.home
    postures = [ARM.robot.random_position(rng, margin=0.3) for _ in range(1000)]

    def ask():
        for posture in postures:
            setpoint.change(goal=posture)

    thread = threading.Thread(target=ask)
    thread.start()
    desired = []
    for _ in range(12000):
        torque = loop.step(home, np.zeros(ARM.n))
        assert np.isfinite(torque).all()
        desired.append(goal.at(setpoint.time).position)
    thread.join()
    assert loop.fault is None, loop.reason
    assert goal.has_arrived
    np.testing.assert_allclose(desired[-1], postures[-1], atol=1e-12)
    limit = 0.5 * np.where(np.isfinite(ARM.robot.velocity_limit), ARM.robot.velocity_limit, 1.0)
    assert (np.abs(np.diff(desired, axis=0)).max(axis=0) <= 1e-3 * limit * (1.0 + 1e-6)).all()


def test_bad_input_is_refused():
    goal = LiveTrajectory(ARM.robot)
    setpoint = Setpoint(goal=goal, stiffness=LiveValue([1.0, 2.0], rate=1.0))
    for change, words in (
        ({"goal": [0.0]}, "shape"),
        ({"goal": [np.nan] * ARM.n}, "finite"),
        ({"goal": ARM.robot.upper + 0.1}, "beyond its limit"),
        ({"stiffness": 3.0}, "shape"),
        ({"goal": ARM.robot.home, "at": -1.0, "stiffness": [1.0, np.inf]}, "finite"),
    ):
        with pytest.raises(InvalidArgumentError, match=words):
            setpoint.change(**change)
    with pytest.raises(UnknownNameError, match="goal"):
        setpoint.change(goall=ARM.robot.home)
    with pytest.raises(InvalidArgumentError, match="must name"):
        Setpoint()
    with pytest.raises(InvalidArgumentError, match="live"):
        Setpoint(goal=[0.0])
    path = LiveFramePath(FRAME, [0.0, 0.0, 0.0])
    with pytest.raises(InvalidArgumentError, match="must be a point"):
        path.request(np.eye(4))
    pose = LiveFramePath(FRAME, np.eye(4))
    for goal_, words in (
        ((np.array([1e6, 0.0, 0.0]), np.eye(3)), "within 1000 m"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "last row"),
        (np.block([[np.eye(3), np.zeros((3, 1))], [np.ones((1, 3)), np.ones((1, 1))]]), "last row"),
    ):
        with pytest.raises(InvalidArgumentError, match=words):
            pose.request(goal_)
    with pytest.raises(InvalidArgumentError, match="no name for a part"):
        Setpoint(at=goal)
    with pytest.raises(InvalidArgumentError, match="rotation is none"):
        pose.request((np.zeros(3), 1.1 * np.eye(3)))
    for limits in ({"speed": 0.0}, {"turning_speed": -1.0}, {"acceleration": np.inf}, {"jerk": 0.0}):
        with pytest.raises(InvalidArgumentError):
            LiveFramePath(FRAME, np.eye(4), **limits)
    law = EnergyShaping.tuned(ARM, reference=goal)
    with pytest.raises(InvalidArgumentError, match="must be a Setpoint"):
        simulate(ARM, law, duration=0.1, setpoint=goal)
    with pytest.raises(InvalidArgumentError, match="must be a Setpoint"):
        ControlLoop(ARM, law, 1e-3, setpoint=goal)
    simulate(ARM, law, duration=0.01, setpoint=setpoint)
    with pytest.raises(InvalidArgumentError, match="make a new one"):
        simulate(ARM, law, duration=0.1, setpoint=setpoint)


def test_a_point_is_changed_through_a_setpoint():
    """At once and later: what was checked is not checked again, as a point is no pair of a point and a rotation."""
    path = LiveFramePath(FRAME, [0.0, 0.0, 0.0])
    setpoint = Setpoint(hand=path)
    setpoint.change(hand=[0.1, 0.0, 0.0])
    setpoint.change(hand=[0.1, 0.2, 0.0], at=5.0)
    setpoint.advance(0.0)
    np.testing.assert_allclose(path.at(4.0).position, [0.1, 0.0, 0.0], atol=1e-12)
    setpoint.advance(5.0)
    np.testing.assert_allclose(path.at(20.0).position, [0.1, 0.2, 0.0], atol=1e-12)


def test_a_goal_that_cannot_be_reached_within_the_limits_changes_nothing():
    """Ruckig fails for ways that take too long: the path goes on, with the orientation that it had."""
    start = (np.zeros(3), turned((0.1, 0.2, 0.3)))
    path = LiveFramePath(FRAME, start, speed=1e-12)
    path.request((np.zeros(3), turned((0.9, 0.2, 0.3))))
    path.advance(0.0)
    path.request((np.array([900.0, 0.0, 0.0]), turned((0.9, 0.2, 0.3))))
    before = path.at(0.5)
    with pytest.raises(PHControlError, match="no motion within the limits"):
        path.advance(0.1)
    for mine, theirs in zip(before, path.at(0.5), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_allclose(path.goal.position, 0.0)
    path.advance(100.0)
    assert path.has_arrived
    path.request(start)
    path.advance(101.0)
    np.testing.assert_allclose(path.at(300.0).rotation, start[1], atol=1e-9)
    np.testing.assert_allclose(path.at(101.0).rotation, turned((0.9, 0.2, 0.3)), atol=1e-9)


def test_a_schedule_on_events_refuses_live_goals():
    """The clocks of its laws begin with their phases, that of a live goal with the loop's."""
    live = LiveTrajectory(ARM.robot)
    laws = [EnergyShaping.tuned(ARM), EnergyShaping.tuned(ARM, reference=live)]
    with pytest.raises(InvalidArgumentError, match="phase 'b' follows a live goal"):
        EventSchedule([Phase("a", laws[0], [(After(1.0), "b")], within=2.0), Phase("b", laws[1])])
    assert live_parts(laws[1]) == [live]
    assert live_parts([lambda t: live.at(t)]) == [live]
    assert live_parts(laws[0]) == []


def test_a_law_that_follows_a_live_goal_is_not_compiled():
    """Its course would stay in C what it was when it was traced: a silent wrong torque."""
    pytest.importorskip("casadi")
    law = EnergyShaping.tuned(ARM, reference=LiveTrajectory(ARM.robot))
    with pytest.raises(PHControlError, match="not compiled"):
        compile_law(law)
    stiffness = LiveValue(1.0, rate=1.0)
    with pytest.raises(InvalidArgumentError, match="a course that changes as it goes"):
        stiffness(symbol_of_casadi())


def symbol_of_casadi():
    import casadi

    return casadi.SX.sym("t")


@pytest.mark.parametrize("law", ["cartesian", "shaping"])
def test_a_goal_out_of_reach_warns_once_and_says_by_how_much(law):
    """When it is asked for, not in each step; the hand then rests where it was said."""
    system = arm("panda")
    frame, home = system.hand_frame, system.robot.near_home()
    start = system.at(home).placement(frame)
    goal = LiveFramePath(frame, start, speed=1.0)
    gains = {"translational_stiffness": 600.0, "rotational_stiffness": 30.0}
    if law == "cartesian":
        made = CartesianTracking.tuned(system, home, path=goal, **gains)
    else:
        made = EnergyShaping.tuned(system, home, potential=FrameSpring(frame, start, **gains), reference=goal)
    setpoint = Setpoint(goal=goal)
    far = start.translation + np.array([0.6, 0.0, 0.0])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        setpoint.change(goal=(start.translation + np.array([0.0, 0.1, 0.0]), start.rotation), at=0.01)
        assert not caught
        setpoint.change(goal=(far, start.rotation), at=0.02)
        assert len(caught) == 1
        simulate(system, made, q0=home, duration=0.05, setpoint=setpoint)
        goal.request((far + np.array([0.0, 0.0, 0.01]), start.rotation))  # dragged on
        assert len(caught) == 1
        setpoint.change(goal=(3.0 * far, start.rotation))
        setpoint.change(goal=(start.translation, start.rotation))
        setpoint.change(goal=(far, start.rotation))
    assert [w.category for w in caught] == [UserWarning] * 3
    message = str(caught[0].message)
    assert f"the goal of '{frame}' is out of reach, by " in message
    with pytest.warns(UserWarning, match="out of reach"):
        held = CartesianImpedance(system, goal=Pose(far, start.rotation), preferred_posture=home, **gains)
    said = re.search(r"by ([0-9.]+) m and ([0-9.]+) rad", message)
    assert float(said[1]) == pytest.approx(held.out_of_reach.distance, rel=1e-2)
    assert float(said[2]) == pytest.approx(held.out_of_reach.angle, rel=2e-2)
    assert held.out_of_reach.distance > 0.05


def test_a_goal_that_is_not_found_from_where_the_last_one_was_is_looked_for_from_the_start():
    """Both are poses that the arm takes: there is nothing to warn of, though the way from one ends in a dead end."""
    system, generator = arm("panda"), np.random.default_rng(10)
    frame, home = system.hand_frame, system.robot.near_home()
    start = system.at(home).placement(frame)
    path = LiveFramePath(frame, start, speed=1.0)
    spring = FrameSpring(frame, start, translational_stiffness=600.0, rotational_stiffness=30.0)
    law = EnergyShaping.tuned(system, home, potential=spring, reference=path)
    first, second = (
        Pose(place.translation, place.rotation)
        for place in (system.at(system.robot.random_position(generator)).placement(frame) for _ in range(2))
    )
    found = law.leading_spring.minimum_near(system, law.start_posture, first)
    stuck = law.leading_spring.minimum_near(system, found, second)
    assert sum(law.leading_spring.deviation(system.at(stuck), second)) > 0.1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for goal in (first, second):
            path.request((goal.translation, goal.rotation))


def test_goals_that_were_asked_for_before_there_was_a_law_are_heard_of():
    system = arm("panda")
    start = system.at(system.robot.near_home()).placement(system.hand_frame)
    goal = LiveFramePath(system.hand_frame, start)
    goal.request((start.translation + np.array([2.0, 0.0, 0.0]), start.rotation))
    with pytest.warns(UserWarning, match="out of reach, by"):
        CartesianTracking.tuned(system, path=goal)
