"""Arms that carry their weight themselves: what is sent, what the motors carry, and the first period."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import (
    ControlBox,
    ControlLoop,
    InvalidArgumentError,
    Limits,
    SimulatedArm,
    TorqueFilter,
    UnknownNameError,
    drive,
    make_controller,
)
from phcontrol.safety.torque_range import RobotShare, torque_range
from tests.conftest import make_system
from tests.runtime.test_control_loop import PERIOD, Clock

RATE = 1000.0  # [N·m/s]


def run(gravity, seconds=0.4, *, stiffness=None, rate=None, **arguments):
    """Drive a Panda through a step; return positions, sent torques, and what the motors carried."""
    system = make_system("panda")
    goal = np.clip(system.robot.home + 0.6, system.robot.lower + 0.1, system.robot.upper - 0.1)
    gains = {} if stiffness is None else {"stiffness": stiffness * system.at(system.robot.home).mass_matrix.diagonal()}
    box = ControlBox(system, period=PERIOD, gravity=gravity)
    if rate is not None:
        limits = Limits(system, torque_rate=rate)
        arguments["torque_filter"] = TorqueFilter(system, period=PERIOD, limits=limits)
    law = make_controller("energy_shaping", system, goal, **gains)
    loop = ControlLoop(system, law, PERIOD, clock=Clock(), **arguments)
    positions, sent, carried = [], [], []

    def note(t, reading, torque):
        positions.append(reading.position)
        sent.append(torque)
        weight = system.at(reading.position).gravity if gravity == "robot" else 0.0
        carried.append(torque + weight)

    drive(loop, SimulatedArm(box), seconds, each_step=note)
    assert loop.fault is None
    return np.array(positions), np.array(sent), np.array(carried)


def test_an_arm_that_adds_its_weight_moves_as_one_that_does_not():
    """The law, the ramp from holding and the stop: the motors carry the same, up to the weight within a period."""
    by_robot, by_controller = run("robot", start_time=0.1), run("controller", start_time=0.1)
    assert np.abs(by_robot[1] - by_controller[1]).max() > 20.0  # what is sent is another thing
    # the box adds the weight at every instant, the loop at each period's start: 1 ms times the weight's rate
    np.testing.assert_allclose(by_robot[0], by_controller[0], atol=2e-4)
    np.testing.assert_allclose(by_robot[2], by_controller[2], atol=0.2)


@pytest.mark.parametrize("rate", [None, RATE])
@pytest.mark.parametrize("gravity", ["robot", "controller"])
@pytest.mark.parametrize("start_time", [0.0, 0.1])
def test_effort_and_rate_hold_for_what_is_sent_and_for_what_is_carried(gravity, rate, start_time):
    """Stiff gains and a step: −105.95 N·m had been sent after a clip to 87, and 8966 N·m/s in the first period."""
    system = make_system("panda")
    seconds = 0.12 if rate is None else 0.4  # without the filter the arm soon moves too fast to believe
    _, sent, carried = run(gravity, seconds, stiffness=2500.0, rate=rate, start_time=start_time)
    effort, resting = system.robot.effort_limit, system.at(system.robot.home).gravity
    before = {"sent": resting if gravity == "controller" else np.zeros(7), "carried": resting}
    for name, torques in (("sent", sent), ("carried", carried)):
        assert np.abs(torques / effort).max() <= 1.0 + 1e-12, name
        if rate is not None:
            changes = np.diff(torques, axis=0, prepend=[before[name]])
            assert 0.99 * rate < np.abs(changes).max() / PERIOD <= rate * (1.0 + 1e-9), name
        else:
            assert np.abs(torques / effort).max() > 0.95, name  # the limit was reached


def test_the_first_torque_starts_from_what_the_arm_says_it_was_sent():
    system = make_system("panda")
    limits = Limits(system, torque_rate=RATE)
    for gravity in ("robot", "controller"):
        loop = ControlLoop(
            system,
            make_controller("energy_shaping", system, system.robot.home),
            PERIOD,
            torque_filter=TorqueFilter(system, period=PERIOD, limits=limits),
            start_time=0.0,
            gravity=gravity,
            clock=Clock(),
        )
        before = np.array([5.0, -5.0, 5.0, -5.0, 2.0, -2.0, 2.0])
        torque = loop.step(system.robot.home, np.zeros(7), torque=before)
        assert np.abs(torque - before).max() <= RATE * PERIOD + 1e-12
        assert np.abs(torque - before).max() >= 0.9 * RATE * PERIOD


@given(
    effort=st.floats(1.0, 100.0),
    step=st.floats(1e-3, 10.0),
    previous=st.floats(-1.0, 1.0),
    weight=st.floats(-1.0, 1.0),
    change=st.floats(-1.0, 1.0),
    shared=st.booleans(),
)
def test_the_range_is_all_torques_that_keep_the_four_limits(effort, step, previous, weight, change, shared):
    """Against the four inequalities, at a grid of torques; start from a torque that kept them."""
    share = RobotShare(np.array([weight * effort + change * step]), np.array([weight * effort])) if shared else None
    added = np.zeros(2) if share is None else np.array([share.now[0], share.before[0]])
    last = np.clip(previous * effort, max(-effort, added[1] - effort), min(effort, added[1] + effort))
    low, high = torque_range(np.array([effort]), np.array([step]), np.array([last]), share)
    assert low <= high
    torques = np.linspace(-1.2 * effort, 1.2 * effort, 1001)
    sent, sent_before = torques - added[0], last - added[1]
    allowed = (np.abs(torques) <= effort) & (np.abs(sent) <= effort)
    allowed &= (np.abs(torques - last) <= step) & (np.abs(sent - sent_before) <= step)
    inside = (torques >= low[0]) & (torques <= high[0])
    near = np.minimum(np.abs(torques - low[0]), np.abs(torques - high[0])) < 1e-9 * effort
    assert (allowed == inside)[~near].all() or not allowed.any()


def test_who_carries_the_weight_must_be_said_and_does_not_change_while_the_loop_runs():
    system = make_system("panda")
    loop = ControlLoop(system, make_controller("energy_shaping", system), PERIOD, clock=Clock())

    class Silent:
        pace = "write"

    with pytest.raises(InvalidArgumentError, match="Silent does not say its gravity; it must be 'robot' or 'contr"):
        drive(loop, Silent(), 0.1)
    Silent.gravity = "Robot"
    with pytest.raises(InvalidArgumentError, match="Silent says 'Robot' for its gravity"):
        drive(loop, Silent(), 0.1)
    Silent.gravity, Silent.pace = "robot", None
    with pytest.raises(InvalidArgumentError, match="does not say its pace; it must be 'clock' or 'read' or 'write'"):
        drive(loop, Silent(), 0.1)
    loop.step(system.robot.home, np.zeros(7))
    with pytest.raises(InvalidArgumentError, match="gravity: is 'controller' and cannot change"):
        loop.gravity = "robot"
    with pytest.raises(UnknownNameError, match="gravity"):
        ControlBox(system, gravity="both")


def test_a_stopped_loop_sends_nothing_but_damping_to_an_arm_that_carries_itself():
    system = make_system("panda")
    loop = ControlLoop(system, make_controller("energy_shaping", system), PERIOD, gravity="robot", clock=Clock())
    loop.stop()
    np.testing.assert_allclose(loop.step(system.robot.home, np.zeros(7)), 0.0, atol=1e-12)
    assert (loop.step(system.robot.home, np.full(7, 0.1)) < 0.0).all()


def test_a_model_that_fails_leaves_the_last_weight_with_the_robot():
    """Without the model the ramp goes on: what is sent stays free of the weight that the robot adds."""
    system = make_system("panda").twin()
    loop = ControlLoop(
        system, make_controller("energy_shaping", system), PERIOD, gravity="robot", stop_time=0.01, clock=Clock()
    )
    for _ in range(5):
        loop.step(system.robot.home, np.zeros(7))
    system.at = None
    loop._sampled.controller = None
    for _ in range(20):
        torque = loop.step(system.robot.home, np.zeros(7))
    assert loop.fault is not None
    np.testing.assert_allclose(torque, 0.0, atol=1e-9)


@pytest.mark.parametrize("gravity", ["robot", "controller"])
def test_after_a_torque_that_was_lost_the_next_is_within_the_rate_of_what_the_arm_still_holds(gravity):
    """An arm that gets two torques of three: a simulated Franka stopped at 1962 N·m/s, of which the loop saw 981."""
    system = make_system("panda")
    q, goal = system.robot.home, np.clip(system.robot.home + 0.6, system.robot.lower + 0.1, system.robot.upper - 0.1)
    loop = ControlLoop(
        system,
        make_controller("energy_shaping", system, goal),
        PERIOD,
        torque_filter=TorqueFilter(system, period=PERIOD, limits=Limits(system, torque_rate=RATE)),
        start_time=0.0,
        gravity=gravity,
        clock=Clock(),
    )
    held = system.at(q).gravity if gravity == "controller" else np.zeros(7)
    changes = []
    for k in range(60):
        torque = loop.step(q + 1e-3 * np.sin(0.3 * k), np.zeros(7), torque=held.astype(np.float32))
        if k % 3 != 1:
            changes.append(np.abs(torque - held).max())
            held = torque
    assert max(changes) <= RATE * PERIOD + 1e-5
    assert max(changes) > 0.9 * RATE * PERIOD
    assert loop.counts["lost"] == 20
