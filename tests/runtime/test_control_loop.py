"""The control loop: the simulator's torques, ramps, watchdogs, and bad networks in simulated time."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    ControlBox,
    ControlLoop,
    InvalidArgumentError,
    Limits,
    LoopMode,
    Measured,
    MissingMeasurementError,
    PacketFaults,
    SimulatedArm,
    TorqueFilter,
    drive,
    make_controller,
    simulate,
)

PERIOD = 1e-3
GOAL = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]


class Clock:
    """A clock that goes on by a step each time it is read."""

    def __init__(self, step=0.0):
        self.now, self.step = 0.0, step

    def __call__(self):
        self.now += self.step
        return self.now


def make_loop(system, law="force_feedback", goal=GOAL, **arguments):
    arguments = {"start_time": 0.0, "clock": Clock()} | arguments
    return ControlLoop(system, make_controller(law, system, goal), PERIOD, **arguments)


def run(loop, arm, seconds):
    """Run and return modes, torques, positions and speeds."""
    modes, torques, positions, speeds = [], [], [], []

    def note(t, reading, torque):
        modes.append(loop.mode)
        torques.append(torque)
        positions.append(arm.box.reading().position)
        speeds.append(arm.box.reading().velocity)

    drive(loop, arm, seconds, each_step=note)
    return modes, np.array(torques), np.array(positions), np.array(speeds)


@pytest.mark.parametrize("filtered", [False, True])
def test_on_a_perfect_arm_the_loop_is_the_simulators_sampled_control(pera, filtered):
    """Same torques, same trajectory, to rounding: one code for both."""
    law = make_controller("force_feedback", pera, GOAL)
    limits = Limits(pera, velocity_margin=0.1)
    filters = [TorqueFilter(pera, period=PERIOD, limits=limits) if filtered else None for _ in range(2)]
    start = np.clip(0.5 * (pera.robot.lower + pera.robot.upper), -1.0, 1.0)
    log = simulate(
        pera,
        law,
        duration=0.3,
        dt=PERIOD,
        q0=start,
        control_period=PERIOD,
        torque_filter=filters[0],
        torque_limit="robot",
    )
    loop = ControlLoop(pera, law, PERIOD, start_time=0.0, torque_filter=filters[1], clock=Clock())
    arm = SimulatedArm(ControlBox(pera, period=PERIOD, position=start))
    modes, torques, positions, _ = run(loop, arm, 0.3)
    assert set(modes) == {LoopMode.RUNNING}
    np.testing.assert_allclose(torques, log.torque[:300], atol=1e-6)
    np.testing.assert_allclose(positions, log.position[1:301], atol=1e-9)
    if filtered:
        assert (log.filter_activity["status"] > 0).any()


def test_the_start_goes_smoothly_from_holding_to_the_law(pera):
    loop = make_loop(pera, start_time=0.2)
    arm = SimulatedArm(ControlBox(pera, period=PERIOD, position=np.clip(pera.robot.home + 0.2, -1, 0)))
    modes, torques, _, _ = run(loop, arm, 0.4)
    assert modes[0] == LoopMode.STARTING
    assert modes[-1] == LoopMode.RUNNING
    assert modes.index(LoopMode.RUNNING) == pytest.approx(200, abs=2)
    x = pera.at(np.clip(pera.robot.home + 0.2, -1, 0))
    np.testing.assert_allclose(torques[0], x.potential_gradient, atol=1e-12)
    law_torque = make_controller("force_feedback", pera, GOAL).evaluate(0.0, x, np.zeros(7)).torque
    assert np.abs(np.diff(torques, axis=0)).max() < 0.03 * np.abs(law_torque - torques[0]).max()


def test_a_stop_ends_in_gravity_and_damping_and_stays(pera):
    loop = make_loop(pera, stop_time=0.1)
    arm = SimulatedArm(ControlBox(pera, period=PERIOD))
    run(loop, arm, 0.2)
    loop.stop("the operator said so")
    modes, torques, _, _ = run(loop, arm, 1.0)
    assert modes[0] == LoopMode.STOPPING
    assert modes[-1] == LoopMode.STOPPED
    assert modes.count(LoopMode.STOPPING) == pytest.approx(100, abs=2)
    assert loop.reason == "the operator said so"
    reading = arm.read()
    assert np.abs(reading.velocity).max() < 1e-3
    np.testing.assert_allclose(torques[-1], pera.at(reading.position).gravity, atol=0.05)
    assert np.abs(np.diff(torques, axis=0)).max() < 2.0  # no jump on the way
    loop.restart()
    assert run(loop, arm, 0.1)[0][-1] == LoopMode.RUNNING


def test_a_stale_reading_stops_the_loop_and_fresh_ones_start_it_again(pera):
    loop = make_loop(pera, stop_time=0.02, stale_after=0.01)
    q, v = np.array(pera.robot.home), np.zeros(7)
    for _ in range(50):
        loop.step(q, v)
    assert loop.mode == LoopMode.RUNNING
    for k in range(60):
        torque = loop.step(q, v + 0.3, age=(k + 1) * PERIOD)
    assert loop.mode == LoopMode.STOPPED
    assert "no reading for 0.011 s" in loop.reason
    np.testing.assert_allclose(torque, pera.at(q).gravity, atol=1e-12)  # the velocity is not believed any more
    assert loop.counts["stops"] == 1
    for _ in range(99):
        loop.step(q, v)
    assert loop.mode == LoopMode.STOPPED
    for _ in range(3):
        loop.step(q, v)
    assert loop.mode in (LoopMode.STARTING, LoopMode.RUNNING)


def test_one_late_reading_is_nothing(pera):
    loop = make_loop(pera)
    q, v = np.array(pera.robot.home), np.zeros(7)
    for k in range(100):
        loop.step(q, v, age=(k % 5) * PERIOD)
    assert loop.mode == LoopMode.RUNNING
    assert loop.counts == {"stale": 0, "implausible": 0, "measured": 0, "stops": 0, "lost": 0}


@pytest.mark.parametrize(
    "implausible",
    [
        lambda q: (q + 0.5, np.zeros(7)),
        lambda q: (q * np.nan, np.zeros(7)),
        lambda q: (q, np.full(7, np.inf)),
        lambda q: (q, np.full(7, 100.0)),
        lambda q: (q[:6], np.zeros(6)),
        lambda q: (q + 0j, np.zeros(7)),
        lambda q: (q, np.zeros(7, dtype=bool)),
        lambda q: ([str(value) for value in q], np.zeros(7)),
        lambda q: (np.append(q, 0.0), np.zeros(6)),
        lambda q: (q + 100.0, np.zeros(7)),
        lambda q: (None, None),
        lambda q: ("here", "there"),
    ],
    ids=["jump", "nan", "inf", "too fast", "short", "complex", "bool", "digits", "shifted", "far", "none", "text"],
)
def test_implausible_readings_are_not_used_and_three_stop_the_loop(pera, implausible):
    loop = make_loop(pera)
    q = np.array(pera.robot.home)
    before = None
    for _ in range(20):
        before = loop.step(q, np.zeros(7))
    torque = loop.step(*implausible(q))
    assert loop.mode == LoopMode.RUNNING
    assert np.abs(torque - before).max() < 1.0
    for _ in range(2):
        torque = loop.step(*implausible(q))
        assert np.isfinite(torque).all()
    assert loop.mode == LoopMode.STOPPING
    assert loop.counts["implausible"] == 3
    assert "do not make sense" in loop.reason


def test_an_arm_that_really_is_elsewhere_is_believed_after_the_stop(pera):
    loop = make_loop(pera, stop_time=0.01)
    q = np.array(pera.robot.home)
    for _ in range(20):
        loop.step(q, np.zeros(7))
    for _ in range(200):
        torque = loop.step(q - 0.5, np.zeros(7))
    assert loop.counts["stops"] == 1
    assert loop.mode in (LoopMode.STARTING, LoopMode.RUNNING)
    assert np.isfinite(torque).all()


def test_a_continuous_joint_may_pass_its_seam():
    from tests.conftest import make_system

    system = make_system("kinova")
    loop = make_loop(system, goal=None)
    q = np.array(system.robot.home)
    q[0] = np.pi - 1e-4
    for _ in range(5):
        loop.step(q, np.zeros(system.n))
    q[0] = -np.pi + 1e-4
    loop.step(q, np.zeros(system.n))
    assert loop.counts["implausible"] == 0


def test_before_the_first_reading_there_is_no_torque(pera):
    loop = make_loop(pera)
    np.testing.assert_array_equal(loop.step(np.full(7, np.nan), np.zeros(7)), np.zeros(7))
    assert loop.mode == LoopMode.WAITING


def test_a_law_that_never_gets_what_it_needs_is_stopped_for_good(pera):
    loop = make_loop(pera, law="force_feedback_measured", stop_time=0.01)
    q = np.array(pera.robot.home)
    for _ in range(300):
        torque = loop.step(q, np.zeros(7))  # there is no force sensor
        assert np.isfinite(torque).all()
    assert loop.mode == LoopMode.STOPPED
    assert isinstance(loop.fault, MissingMeasurementError)
    np.testing.assert_allclose(torque, pera.at(q).gravity, atol=1e-12)
    loop.restart()
    loop.step(q, np.zeros(7), Measured(np.zeros(7)))
    assert loop.mode in (LoopMode.STARTING, LoopMode.RUNNING)
    assert loop.fault is None


def test_missed_deadlines_are_counted_and_many_stop_the_loop(pera):
    clock = Clock(step=0.4 * PERIOD)
    loop = make_loop(pera, clock=clock, deadline=0.45 * PERIOD, stop_time=0.01)
    q = np.array(pera.robot.home)
    for _ in range(50):
        loop.step(q, np.zeros(7))
    assert loop.timing.misses == 0
    clock.step = 0.5 * PERIOD
    for _ in range(19):
        loop.step(q, np.zeros(7))
    assert loop.mode == LoopMode.RUNNING
    loop.step(q, np.zeros(7))
    assert loop.mode == LoopMode.STOPPING
    assert "20 periods more were missed than kept" in loop.reason
    assert loop.timing.misses == 20
    assert loop.timing.skipped == 0
    assert loop.timing.steps == 70
    clock.step = 0.4 * PERIOD
    for _ in range(120):
        loop.step(q, np.zeros(7))
    assert loop.mode == LoopMode.RUNNING


def test_skipped_periods_count_as_missed(pera):
    clock = Clock(step=0.4 * PERIOD)
    loop = make_loop(pera, clock=clock)
    q = np.array(pera.robot.home)
    for _ in range(50):
        loop.step(q, np.zeros(7))
    clock.step = 2.0 * PERIOD
    for _ in range(5):
        assert loop.mode == LoopMode.RUNNING
        loop.step(q, np.zeros(7))
    # these five steps begin 2.4, 6.4 ... 18.4 ms after the 50th and compute for 2 ms: none of 18 periods was kept
    assert loop.timing.misses == 18
    assert loop.timing.skipped == 13
    loop.step(q, np.zeros(7))
    assert loop.mode == LoopMode.STOPPING


# --- bad networks -------------------------------------------------------------------------------------


def bad_network(pera, *, outages=(), loss=0.05, seed=0, **loop_arguments):
    limits = Limits(pera, torque_rate=2000.0, velocity_margin=0.1)
    loop = make_loop(
        pera,
        start_time=0.1,
        stop_time=0.05,
        torque_filter=TorqueFilter(pera, period=PERIOD, limits=limits),
        **loop_arguments,
    )
    faults = {"loss": loss, "delay": 5e-4, "jitter": 1e-3, "duplicates": 0.05, "outages": outages}
    box = ControlBox(pera, period=PERIOD)
    return loop, SimulatedArm(
        box, readings=PacketFaults(**faults, seed=seed), commands=PacketFaults(**faults, seed=seed + 100)
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_with_loss_delay_duplicates_and_reordering_the_arm_arrives(pera, seed):
    loop, arm = bad_network(pera, seed=seed)
    modes, torques, _, speeds = run(loop, arm, 6.0)
    assert modes[-1] == LoopMode.RUNNING
    assert loop.counts["stops"] == 0
    assert arm.box.counts["refused"] > 100  # duplicates, and those overtaken
    np.testing.assert_allclose(arm.box.reading().position, GOAL, atol=0.03)
    assert (np.abs(torques) <= pera.robot.effort_limit).all()
    assert (np.abs(speeds) <= pera.robot.velocity_limit * 1.05).all()


def test_outages_of_50_ms_stop_the_loop_and_it_goes_on(pera):
    outages = [(0.5, 0.05), (1.5, 0.05)]
    loop, arm = bad_network(pera, outages=outages)
    modes, torques, _, speeds = run(loop, arm, 6.0)
    for start, _ in outages:
        during = modes[round(1e3 * start) + 15 : round(1e3 * start) + 45]
        assert LoopMode.RUNNING not in during
        assert LoopMode.STOPPING in during
    visited = [mode for mode, before in zip(modes, [None, *modes], strict=False) if mode != before]
    cycle = [LoopMode.STARTING, LoopMode.RUNNING, LoopMode.STOPPING, LoopMode.STOPPED]
    assert visited == [*cycle, *cycle, *cycle[:2]]
    assert arm.box.counts["braking"] > 30  # the box's own watchdog, after 20 ms without a command
    np.testing.assert_allclose(arm.box.reading().position, GOAL, atol=0.03)
    assert (np.abs(speeds) <= pera.robot.velocity_limit * 1.05).all()
    assert np.isfinite(torques).all()


def test_a_network_that_dies_leaves_an_arm_at_rest(pera):
    loop, arm = bad_network(pera, outages=[(0.3, 100.0)])
    modes, _, positions, speeds = run(loop, arm, 3.0)
    assert modes[-1] == LoopMode.STOPPED
    assert np.abs(speeds[-1]).max() < 1e-2
    assert np.abs(positions[-1] - positions[-500]).max() < 1e-2


# --- bad arguments --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start_time": -1.0}, "start_time: must be >= 0"),
        ({"stop_time": np.nan}, "stop_time: must be finite"),
        ({"stale_after": 0.0}, "stale_after: must be > 0"),
        ({"deadline": 0.0}, "deadline: must be > 0"),
        ({"holding_damping": -1.0}, "holding_damping: must be 0 to"),
        ({"torque_limit": -5.0}, "torque_limit: must be > 0"),
        ({"torque_filter": "strong"}, "torque_filter: must be a TorqueFilter"),
    ],
)
def test_bad_arguments_are_refused(pera, arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        make_loop(pera, **arguments)


def test_a_filter_for_another_period_or_arm_is_refused(pera, shoulder):
    with pytest.raises(InvalidArgumentError, match=r"works every 0\.002 s, but the control period is 0\.001 s"):
        make_loop(pera, torque_filter=TorqueFilter(pera, period=2e-3))
    with pytest.raises(InvalidArgumentError, match="is for 2 joints"):
        make_loop(pera, torque_filter=TorqueFilter(shoulder, period=PERIOD))
    law = make_controller("energy_shaping", shoulder)
    with pytest.raises(InvalidArgumentError, match="controller: is for 2 joints"):
        ControlLoop(pera, law, PERIOD)
    with pytest.raises(InvalidArgumentError, match="works every"):
        simulate(shoulder, law, duration=0.1, control_period=2e-3, torque_filter=TorqueFilter(shoulder, period=PERIOD))
