"""Schedules that switch on what happens: when, what is handed over, what is said when nothing happens."""

from __future__ import annotations

import numpy as np
import pytest

import phcontrol as ph
from phcontrol import After, EventSchedule, InvalidArgumentError, Phase, Seen, Settled, Touched, UnknownNameError, When
from phcontrol.controllers.event_schedule import STOP
from tests.conftest import make_system

GOAL = [0.5, 0.3]
GAINS = {"stiffness": 20.0, "damping": 5.0}


def push_after(start, force):
    return lambda t, x: np.array(force) if t >= start - 1e-12 else np.zeros(2)


def spring(system, **arguments):
    return ph.make_controller("energy_shaping", system, goal=GOAL, **arguments)


def reach_from(system):
    def made(at):
        way = ph.MinimumJerk.within_limits(system.robot, at.desired, np.array(GOAL))
        return ph.make_controller("energy_shaping", system, reference=way, **GAINS)

    return made


def run(system, schedule, **arguments):
    log = ph.simulate(system, schedule, **({"duration": 2.0, "dt": 2e-3} | arguments))
    return log, schedule.switches(log.time, log.controller_state)


def test_it_switches_when_touched_for_long_enough(shoulder):
    schedule = EventSchedule([
        Phase("wait", spring(shoulder), [(Touched(1.0, "shoulder_pitch", lasting=0.1), "yield")], within=5.0),
        Phase("yield", spring(shoulder, stiffness=1.0)),
    ])  # fmt: skip
    log, switches = run(shoulder, schedule, disturbance=push_after(0.5, [-1.5, 0.0]))
    assert [(s.leaving, s.entering, s.event) for s in switches] == [("wait", "yield", "touched")]
    assert switches[0].time == pytest.approx(0.6, abs=2e-3 + 1e-9)
    assert schedule.phase(log.controller_state[-1]) == "yield"
    assert run(shoulder, schedule, disturbance=lambda t, x: np.array([-1.5 * (0.5 < t < 0.59), 0.0]))[1] == []
    assert run(shoulder, schedule, disturbance=push_after(0.5, [-0.99, 5.0]))[1] == []


def test_figures_at_a_switch_are_those_of_both_laws(shoulder):
    first, second = spring(shoulder), spring(shoulder, stiffness=[7.0, 9.0])
    schedule = EventSchedule([Phase("a", first, [(After(0.4), "b")], within=1.0), Phase("b", second)])
    log, [switch] = run(shoulder, schedule)
    k = round(0.4 / 2e-3)
    assert switch.time == log.time[k]
    x = shoulder.at(log.position[k], log.velocity[k])
    empty = np.zeros(0)
    assert switch.storage_before == first.storage(0.4, x, empty)
    assert switch.storage_after == second.storage(0.0, x, empty) == log.storage[k]
    difference = first.evaluate(0.4, x, empty).torque - second.evaluate(0.0, x, empty).torque
    assert switch.torque_jump == pytest.approx(np.abs(difference).max(), rel=1e-12)
    assert "a -> b (after)" in str(switch)
    # beside the switch it is what a run of each law alone gives
    alone = ph.simulate(shoulder, first, duration=0.4, dt=2e-3)
    np.testing.assert_array_equal(log.position[: k + 1], alone.position)
    on = ph.simulate(shoulder, second, duration=1.6, dt=2e-3, q0=alone.position[-1], v0=alone.velocity[-1])
    np.testing.assert_allclose(log.position[k:], on.position, atol=1e-12)


@pytest.mark.parametrize("control_period", [None, 4e-3])
def test_what_is_desired_does_not_jump(shoulder, control_period):
    """A law that is led starts where the last one wanted the arm, or where the arm is; its clock starts then."""
    home = shoulder.robot.home
    schedule = EventSchedule([
        Phase("push", ph.EnergyShaping(shoulder, goal=home, **GAINS), [(After(0.5), "reach")], within=9.0),
        Phase("reach", reach_from(shoulder), [(Settled(0.01, position=0.01), "stay")], within=9.0),
        Phase("stay", "reach"),
    ])  # fmt: skip
    log, switches = run(shoulder, schedule, disturbance=[0.5, 0.0], duration=4.0, control_period=control_period)
    assert [switch.entering for switch in switches][:1] == ["reach"]
    k = round(switches[0].time / 2e-3)
    law = schedule.acting(log.time[k], log.controller_state[k]).law
    np.testing.assert_array_equal(law.target_posture(0.0), home)  # what the first law desired, not where it was
    assert np.abs(log.position[k] - home).max() > 1e-3
    # the spring alone makes both torques: the same desired posture, so the same torque
    assert switches[0].torque_jump < 1e-9
    assert switches[0].storage_before == pytest.approx(switches[0].storage_after, rel=1e-9)


def test_a_law_that_goes_on_keeps_its_clock(shoulder):
    names = ["one", "two"]
    led = EventSchedule([
        Phase("one", spring(shoulder), [(After(0.2), "go")], within=1.0),
        Phase("go", reach_from(shoulder), [(After(0.3), "on")], within=1.0),
        Phase("on", "go"),
    ])  # fmt: skip
    log, switches = run(shoulder, led)
    assert [s.time for s in switches] == pytest.approx([0.2, 0.5])
    assert switches[1].torque_jump == 0.0
    assert switches[1].storage_before == switches[1].storage_after
    without = EventSchedule([
        Phase(names[0], spring(shoulder), [(After(0.2), names[1])], within=1.0), Phase(names[1], reach_from(shoulder)),
    ])  # fmt: skip
    np.testing.assert_allclose(run(shoulder, without)[0].position, log.position, atol=1e-12)


def test_an_event_that_never_comes_ends_in_the_stop_and_is_said(shoulder):
    schedule = EventSchedule([
        Phase("wait", spring(shoulder), [(Touched(1.0), "done"), (When(lambda m: False, "luck"), "done")], within=0.7),
        Phase("done", spring(shoulder)),
    ])  # fmt: skip
    assert schedule.report(schedule.initial_state(shoulder.at(shoulder.robot.home))) == "about to begin with 'wait'"
    log, [switch] = run(shoulder, schedule, duration=12.0)
    assert (switch.entering, switch.event) == (STOP, "nothing of 'touched' or 'luck' within 0.7 s")
    assert switch.time == pytest.approx(0.7)
    end = log.controller_state[-1]
    assert schedule.report(end) == "STOPPED since 0.70 s, out of 'wait': nothing of 'touched' or 'luck' within 0.7 s"
    k = round(0.7 / 2e-3)
    assert schedule.report(log.controller_state[k - 1]) == "in 'wait' since 0.00 s"
    np.testing.assert_allclose(log.position[-1], log.position[k], atol=1e-4)  # held where it was
    assert np.abs(log.velocity[k]).max() > 0.01
    assert np.abs(log.velocity[-1]).max() < 1e-4


def test_its_own_stop(shoulder):
    made = []

    def stop(at):
        made.append(at)
        return spring(shoulder, stiffness=3.0)

    schedule = EventSchedule(
        [Phase("wait", spring(shoulder), [(Touched(1.0), "end")], within=0.2), Phase("end", spring(shoulder))],
        stop=stop,
    )
    log, _ = run(shoulder, schedule)
    law = schedule.acting(log.time[-1], log.controller_state[-1]).law
    np.testing.assert_array_equal(law.stiffness, 3.0 * np.eye(2))
    assert len(made) == 2  # an example, and once for the run: not at every step


def test_states_of_given_laws_go_on_and_those_of_made_ones_begin_calm(shoulder):
    feedback, integral = (ph.make_controller(n, shoulder, goal=GOAL) for n in ("force_feedback", "integral_action"))
    given = EventSchedule([Phase("a", feedback, [(After(0.5), "b")], within=1.0), Phase("b", integral)])
    places = {name: given.acting(0.0, given.initial_state(shoulder.at(GOAL))).places for name in "a"}
    log, _ = run(shoulder, given, disturbance=[3.0, -3.0])
    z = log.controller_state[:, places["a"]]
    k = round(0.5 / 2e-3)
    assert np.abs(z[k]).max() > 1e-2
    assert np.abs(z[k] - z[k - 1]).max() < 2.0 * np.abs(z[k - 1] - z[k - 2]).max()
    made = EventSchedule([
        Phase("a", feedback, [(After(0.5), "b")], within=1.0),
        Phase("b", lambda at: ph.make_controller("force_feedback", shoulder, goal=at.position)),
    ])  # fmt: skip
    log, [switch] = run(shoulder, made, disturbance=[3.0, -3.0])
    acting = made.acting(log.time[k], log.controller_state[k])
    x = shoulder.at(log.position[k], log.velocity[k])
    at_start = log.controller_state[k][acting.places]
    np.testing.assert_array_equal(at_start, acting.law.calmest_state(0.0, x, np.zeros(2)))
    for other in (np.zeros(2), z[k], at_start + 0.1):
        assert acting.law.storage(0.0, x, other) >= switch.storage_after - 1e-12


def test_asked_twice_and_backwards_it_says_the_same(shoulder, rng):
    """Laws are made again from what the state keeps: a call does not depend on the one before."""
    schedule = EventSchedule([
        Phase("a", spring(shoulder), [(After(0.2), "b")], within=1.0), Phase("b", reach_from(shoulder)),
    ])  # fmt: skip
    log, _ = run(shoulder, schedule)
    torques = [schedule.evaluate(log.time[k], shoulder.at(log.position[k], log.velocity[k]),
                                 log.controller_state[k]).torque for k in range(0, len(log), 50)]  # fmt: skip
    other = [schedule.random_state(rng) for _ in range(5)]
    for k in reversed(range(0, len(log), 50)):
        schedule.evaluate(0.1, shoulder.at(GOAL), other[k % 5])
        again = schedule.evaluate(log.time[k], shoulder.at(log.position[k], log.velocity[k]), log.controller_state[k])
        np.testing.assert_array_equal(again.torque, torques[k // 50])
    state = log.controller_state[100].copy()
    before = state.copy()
    schedule.jump(0.5, shoulder.at(GOAL), state)
    np.testing.assert_array_equal(state, before)


def servo_system():
    system = make_system("pera_shoulder_elbow")
    camera = ph.PinholeCamera(image_size=(640, 480), field_of_view=1.0).mounted_on(system.robot)
    return system, camera, ph.HamiltonianServo.tuned(system, camera=camera, lost="hold")


class Blinking:
    """An object that is there in some intervals of time only."""

    quantity, period = "features", None

    def __init__(self, intervals):
        self.intervals = intervals

    def start(self, x, external_force):
        return self.update(None, 0.0, x, external_force, None)

    def update(self, state, t, x, external_force, torque):
        return np.array([1e-3, 0.0, 2e-3]) if any(a <= t < b for a, b in self.intervals) else np.full(3, np.nan)

    def reading(self, state):
        return state


@pytest.mark.parametrize(
    ("intervals", "expected"),
    [
        ([(0.3, 0.7)], [(0.4, "seen", "go"), (0.9, "lost", STOP)]),
        ([(0.3, 0.39), (0.5, 0.58)], [(1.0, "nothing of 'seen' within 1 s", STOP)]),
        ([(0.3, 0.7), (0.85, 1.0), (1.1, 9.0)], [(0.4, "seen", "go"), (1.4, "after", "end")]),
        ([], [(1.0, "nothing of 'seen' within 1 s", STOP)]),
    ],
)
def test_seen_and_lost(intervals, expected):
    system, _, law = servo_system()
    schedule = EventSchedule([
        Phase("look", law, [(Seen(0.1), "go")], within=1.0),
        Phase("go", law, [(ph.Lost(0.2), STOP), (After(1.0), "end")], within=5.0),
        Phase("end", ph.make_controller("energy_shaping", system)),
    ])  # fmt: skip
    log, switches = run(system, schedule, duration=1.8, dt=0.01, sensors=[Blinking(intervals)])
    assert [(round(s.time, 6), s.event, s.entering) for s in switches] == expected
    assert np.isfinite(log.torque).all()


def test_settled_on_features_waits_for_them():
    system, camera, law = servo_system()
    thing = ph.ObservedObject.seen_as(camera, [0.002, 0.001, 0.0025], system.at(system.robot.home))
    law = ph.HamiltonianServo.tuned(system, camera=camera, lost="hold")
    schedule = EventSchedule([
        Phase("go", law, [(Settled(0.02, features=1e-4), "end")], within=20.0),
        Phase("end", lambda at: ph.EnergyShaping.tuned(system, at.position)),
    ])  # fmt: skip
    log, [switch] = run(system, schedule, duration=8.0, dt=4e-3, scene=thing)
    errors = np.abs(log.features - law.goal).max(axis=1)
    k = int(np.searchsorted(log.time, switch.time - 1e-9))
    assert (errors[k - 70 : k] <= 1e-4).all()  # for 0.3 s
    assert errors[0] > 1e-3
    assert np.abs(log.velocity[k - 70 : k]).max() <= 0.02


@pytest.mark.parametrize(
    ("phases", "error", "problem"),
    [
        (lambda law: [], InvalidArgumentError, "at least one Phase"),
        (lambda law: [law], InvalidArgumentError, "must hold phases"),
        (lambda law: [Phase(STOP, law)], InvalidArgumentError, "is the name of the stop"),
        (lambda law: [Phase("", law)], InvalidArgumentError, "must be a name"),
        (lambda law: [Phase("a", law), Phase("a", law)], InvalidArgumentError, "names of their own"),
        (lambda law: [Phase("a", law), Phase("b", law)], InvalidArgumentError, "no event leads to b"),
        (lambda law: [Phase("a", law, [(After(1.0), "b")]), Phase("b", law)], InvalidArgumentError, "how long it"),
        (lambda law: [Phase("a", law, [(After(1.0), "c")], within=2.0)], UnknownNameError, "unknown phase 'c'"),
        (lambda law: [Phase("a", law, [("after", "b")], within=2.0)], InvalidArgumentError, "pairs"),
        (lambda law: [Phase("a", law, within=2.0)], InvalidArgumentError, "waits for nothing"),
        (lambda law: [Phase("a", law, [(After(1.0), STOP)], within=-1.0)], InvalidArgumentError, "within"),
        (lambda law: [Phase("a", law, [(After(1.0), STOP)], within=np.inf)], InvalidArgumentError, "within"),
        (lambda law: [Phase("a", law, [(Seen(), STOP)], within=1.0)], InvalidArgumentError, "none of them has a"),
        (lambda law: [Phase("a", law, [(Touched(1.0, "toe"), STOP)], within=1.0)], InvalidArgumentError, "toe"),
        (lambda law: [Phase("a", "b"), Phase("b", law)], UnknownNameError, "earlier phase 'b'"),
        (lambda law: [Phase("a", 5)], InvalidArgumentError, "must hold a law"),
        (lambda law: [Phase("a", lambda at: law)], InvalidArgumentError, "at least one law that is given"),
        (lambda law: [Phase("a", law, [(After(1.0), "b")], within=2.0), Phase("b", lambda at: None)],
         InvalidArgumentError, "must be one law"),
        (lambda law: [Phase("a", law, [(When(lambda m: True, needs=("smell",)), STOP)], within=2.0)],
         UnknownNameError, "smell"),
        (lambda law: [Phase("a", law, [(After(1.0), "b")], within=2.0),
                      Phase("b", ph.make_controller("energy_shaping", make_system("pera_gripper")))],
         InvalidArgumentError, "same system"),
    ],
)  # fmt: skip
def test_what_makes_no_schedule_is_refused(shoulder, phases, error, problem):
    with pytest.raises(error, match=problem):
        EventSchedule(phases(spring(shoulder)))


@pytest.mark.parametrize(
    "wrong",
    [lambda: Touched(0.0), lambda: Settled(-1.0), lambda: After(0.0), lambda: Seen(-0.1), lambda: When(5)],
)
def test_events_that_make_no_sense_are_refused(wrong):
    with pytest.raises(InvalidArgumentError):
        wrong()


def test_needs_are_those_of_laws_and_events(shoulder):
    schedule = EventSchedule([Phase("a", spring(shoulder), [(Touched(1.0), STOP)], within=1.0)])
    assert schedule.needs == ("external_force",)
    with pytest.raises(ph.MissingMeasurementError, match="'touched' needs"):
        schedule.jump(0.0, shoulder.at(GOAL), schedule.initial_state(shoulder.at(GOAL)))


def test_in_a_control_loop_it_switches_as_in_simulation_and_begins_anew_after_a_restart(shoulder):
    """Sampled alike, with the same push; then the loop is stopped and started again."""
    schedule = EventSchedule([
        Phase("wait", spring(shoulder), [(Touched(1.0, lasting=0.05), "yield")], within=3.0),
        Phase("yield", lambda at: spring(shoulder, stiffness=2.0)),
    ])  # fmt: skip
    period, push = 4e-3, push_after(0.4, [-1.5, 0.0])
    log, [switch] = run(shoulder, schedule, disturbance=push, dt=period, control_period=period, duration=1.0)
    box = ph.ControlBox(shoulder, period=period, disturbance=push)
    loop = ph.ControlLoop(shoulder, schedule, period, start_time=0.0, clock=lambda: box.time, deadline=9.0)
    arm, states = ph.SimulatedArm(box), []
    ph.drive(loop, arm, 1.0, each_step=lambda *_: states.append(loop.controller_state))
    times = np.arange(len(states)) * period
    [same] = schedule.switches(times, np.array(states))
    assert loop.fault is None
    assert (same.leaving, same.entering, same.event) == (switch.leaving, switch.entering, switch.event)
    assert same.time == pytest.approx(switch.time, abs=2 * period)
    assert schedule.report(loop.controller_state).startswith("in 'yield'")
    loop.stop()
    ph.drive(loop, arm, 0.3)
    loop.restart()
    ph.drive(loop, arm, 0.02)
    assert schedule.phase(loop.controller_state) == "wait"
    assert loop.controller_state[1] > 1.0  # its phase began at the restart, not at 0: it waits for its whole time


def stirred(system, initial=0.6):
    stir = ph.ExternalAction(lambda t, x: 8.0 * x.velocity + 0.2)  # takes energy out of the tank all the time
    tank = ph.EnergyTank(initial=initial, lowest=0.02, highest=2.0)
    return ph.with_tank(ph.EnergyShaping)(system, goal=GOAL, **GAINS, actions=stir, tank=tank)


def test_entering_a_phase_again_does_not_fill_its_tank(shoulder):
    """A law made at each hand-over goes on with what is left in its tank; else switching would give energy."""
    schedule = EventSchedule([
        Phase("stir", lambda at: stirred(shoulder), [(After(0.3), "rest")], within=9.0),
        Phase("rest", spring(shoulder), [(After(0.2), "stir")], within=9.0),
    ])  # fmt: skip
    log, switches = run(shoulder, schedule, duration=2.0)
    assert [switch.entering for switch in switches] == ["rest", "stir"] * 4
    law, place = stirred(shoulder), list(schedule.state_parts).index("tank")
    column = sum(list(schedule.state_parts.values())[:place])
    levels = np.array([law.tank.level(state) for state in log.controller_state[:, column]])
    at = [int(np.searchsorted(log.time, switch.time - 1e-9)) for switch in switches]
    for leaving, entering in zip(at[::2], at[1::2], strict=True):
        assert levels[leaving] == levels[entering] < law.tank.initial - 0.05
    assert levels[0] == pytest.approx(law.tank.initial, rel=1e-12)
    assert np.ptp(levels) > 0.3


def test_a_tank_that_starts_at_another_level_at_another_place_is_refused(shoulder):
    def made(at):
        return stirred(shoulder, 0.6 if at.position[0] == shoulder.robot.home[0] else 1.9)

    schedule = EventSchedule([Phase("a", spring(shoulder), [(After(0.1), "b")], within=1.0), Phase("b", made)])
    with pytest.raises(ph.SimulationError, match="'b' must start its tank at the same level"):
        run(shoulder, schedule, q0=[0.2, 0.1], duration=0.2)
