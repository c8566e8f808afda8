"""A period of a law, and what the sensors of a run are given, step by step on stand-ins."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from phcontrol import (
    FilterStatus,
    InvalidArgumentError,
    Limits,
    MechanicalSystem,
    TorqueFilter,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.sensors.measured import NOTHING
from phcontrol.simulation.instruments import Instruments, due_of
from phcontrol.simulation.sampled_control import SampledControl, check_filter
from tests.conftest import make_system

PERIOD = 0.125
CALM = np.array([1.0, -2.0])


class Law:
    """Torque and rate are told; its storage is ½|z − z*|², smallest at z*."""

    system, name, longest_period = SimpleNamespace(n=2), "law", float("inf")

    def __init__(self):
        self.torque, self.rate = np.zeros(2), np.zeros(2)

    def evaluate(self, t, x, state, measured):
        return self.torque, self.rate[: state.size]

    def storage(self, t, x, state, measured=NOTHING):
        return 0.5 * float((state - CALM) @ (state - CALM))

    def calmest_state(self, t, x, state):
        return CALM

    def passive_port(self, t, x, state, measured):
        return ("port", t)


class Filter:
    """Lets everything pass and reports an excess; notes what it was given."""

    def __init__(self, excess=0.0):
        self.excess, self.system, self.storage, self.given = excess, Law.system, None, []

    def filter(self, x, torque, **given):
        self.given.append(given)
        return SimpleNamespace(torque=0.5 * torque, storage_excess=self.excess)


def sampled(law, **options):
    control = SampledControl(law, PERIOD, **options)
    return control, SimpleNamespace(system=Law.system, seen_by=lambda system: None)


def test_a_laws_state_goes_on_by_its_rate_once_a_period():
    law, state = Law(), np.array([1.0, 2.0])
    control, x = sampled(law)
    np.testing.assert_array_equal(control.advance(state), state)  # nothing before the first step
    law.rate = np.array([8.0, -16.0])
    control.step(0.0, x, state, NOTHING)
    np.testing.assert_array_equal(control.advance(state), [2.0, 0.0])
    control.hold_rate(np.array([-8.0, 0.0]))
    np.testing.assert_array_equal(control.advance(state), [0.0, 2.0])


def test_a_torque_is_clipped_to_its_limits_on_both_sides_and_remembered():
    law = Law()
    control, x = sampled(law, torque_limit=np.array([1.0, 2.0]))
    assert control.torque is None
    for desired, applied in [([3.0, -3.0], [1.0, -2.0]), ([-3.0, 3.0], [-1.0, 2.0]), ([0.5, -1.5], [0.5, -1.5])]:
        law.torque = np.array(desired)
        np.testing.assert_array_equal(control.step(0.0, x, np.zeros(0), NOTHING), applied)
        np.testing.assert_array_equal(control.torque, applied)
        np.testing.assert_array_equal(control.desired, desired)


def test_the_filter_is_given_the_last_torque_and_is_clipped_after():
    law = Law()
    control, x = sampled(law, torque_limit=np.array([1.0, 2.0]))
    control.filter = Filter()
    law.torque = np.array([1.0, 8.0])
    np.testing.assert_array_equal(control.step(0.0, x, np.zeros(0), NOTHING), [0.5, 2.0])
    control.filter.storage = True
    control.step(PERIOD, x, np.zeros(0), NOTHING._replace(external_force=np.ones(2)))
    first, second = control.filter.given
    assert first["previous"] is first["port"] is first["external_force"] is None  # without a storage condition no port
    np.testing.assert_array_equal(second["previous"], [0.5, 2.0])
    np.testing.assert_array_equal(second["external_force"], [1.0, 1.0])
    assert second["port"] == ("port", PERIOD)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.5, 0.999, 1.0, 3.0])
def test_energy_that_the_filter_had_to_give_is_taken_out_of_the_laws_state(share):
    """Twice period times excess, or all there is: by what the storage is smaller after one period."""
    law, state = Law(), np.array([3.0, 0.5])
    available = law.storage(0.0, None, state)
    control, x = sampled(law)
    control.filter = Filter(share * available / (2.0 * PERIOD))
    control.step(0.0, x, state, NOTHING)
    left = law.storage(0.0, x, control.advance(state))
    assert left == pytest.approx(available * (1.0 - min(1.0, share)), abs=1e-12)
    control.step(0.0, x, CALM.copy(), NOTHING)  # nothing to be taken
    np.testing.assert_array_equal(control.advance(CALM), CALM)


def test_a_filter_must_suit_law_and_period(shoulder):
    law = SimpleNamespace(system=shoulder)
    torque_filter = TorqueFilter(shoulder, period=1e-3)
    for period in (None, 1e-3, 1e-3 * (1.0 + 0.5e-9), 1e-3 * (1.0 - 0.5e-9)):
        check_filter(torque_filter, law, period)
    for period in (1e-3 * (1.0 + 2e-9), 1e-3 * (1.0 - 2e-9), 2e-3):
        with pytest.raises(InvalidArgumentError, match="torque_filter: works every"):
            check_filter(torque_filter, law, period)
    with pytest.raises(InvalidArgumentError, match="torque_filter: is for 2 joints, the controller for 7"):
        check_filter(torque_filter, SimpleNamespace(system=make_system("pera")), 1e-3)
    with pytest.raises(InvalidArgumentError, match="torque_filter: must be a TorqueFilter, but is str"):
        check_filter("filter", law, 1e-3)


class Noting:
    """A sensor that notes when it was updated and with which torque; shows how often."""

    def __init__(self, quantity, period):
        self.quantity, self.period, self.notes = quantity, period, []

    def start(self, x, external_force):
        return 0

    def update(self, state, t, x, external_force, torque):
        self.notes.append((t, torque.tolist()))
        return state + 1

    def reading(self, state):
        return np.full(2, float(state))


def test_sensors_are_due_at_their_periods_and_see_the_mean_torque_since():
    """The torque goes within each step from what was applied at its start to what the loop ends it with."""
    slow, fast = Noting("external_force", 0.2), Noting("total_force", None)
    instruments = Instruments([slow, fast], 0.1)
    around = SimpleNamespace(external_force=np.zeros(2))
    loop = SimpleNamespace(n=2, plant_state=lambda y: None, surroundings=lambda t, x, y: around)
    shown = []
    for k in range(5):
        loop.torque = lambda t, y, held, k=k: np.array([k + 0.5, 0.0])  # at the end of step k − 1
        shown.append(instruments.observe(k, 0.1 * k, loop, np.zeros(4), None))
        instruments.applied(np.array([float(k), -1.0]))  # at the start of step k
    steps = [[0.5 * (k + k + 1.5), -0.5] for k in range(4)]
    assert [torque for _, torque in fast.notes] == [[0.0, 0.0], *steps]
    assert [round(t, 9) for t, _ in slow.notes] == [0.0, 0.2, 0.4]
    expected = [[0.0, 0.0], np.mean(steps[:2], axis=0), np.mean(steps[2:], axis=0)]
    np.testing.assert_allclose([torque for _, torque in slow.notes], expected)
    assert [measured.external_force[0] for measured in shown] == [1.0, 1.0, 2.0, 2.0, 3.0]
    assert [measured.total_force[0] for measured in shown] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert shown[0].features is None


def test_a_sensor_without_a_period_is_due_at_every_step():
    assert due_of(None, 1e-3) == due_of([], 1e-3) == due_of([Noting("external_force", None)], 1e-3) == 1
    assert due_of([Noting("external_force", 4e-3)], 1e-3) == 4


def test_only_a_sensor_that_reads_joints_is_given_what_these_show():
    class Looking(Noting):
        def update(self, state, t, x, external_force, torque):
            self.notes.append(x)
            return state

    plain, reading = Looking("external_force", None), Looking("total_force", None)
    reading.reads_joints = True
    around = SimpleNamespace(external_force=np.zeros(2))
    loop = SimpleNamespace(n=2, plant_state=lambda y: "true", surroundings=lambda t, x, y: around)
    Instruments([plain, reading], 0.1).observe(0, 0.0, loop, np.zeros(4), None, "shown")
    assert (plain.notes, reading.notes) == (["true"], ["shown"])


def test_a_log_holds_what_the_filter_did(shoulder):
    """As often as the filter itself counts it."""
    guard = TorqueFilter(shoulder, period=1e-3, limits=Limits(shoulder, velocity=0.05))
    law = make_controller("energy_shaping", shoulder, shoulder.robot.home + 0.5)
    log = simulate(shoulder, law, duration=0.02, torque_filter=guard)
    status = log.filter_activity["status"]
    assert len(status) == len(log)
    for each in (FilterStatus.PASSED, FilterStatus.CLIPPED, FilterStatus.SOLVED):
        assert abs((status == each).sum() - guard.counts[each]) <= 1  # the last sample is no new period
    assert (status == FilterStatus.SOLVED).any()


def test_a_law_on_another_model_is_filtered_by_the_filters(shoulder):
    """The filter sees positions and velocities in its own system."""
    other = MechanicalSystem(load_robot("pera_shoulder"), friction=None)
    law = Law()
    law.system = shoulder
    control = SampledControl(
        law, 1e-3, None, TorqueFilter(other, period=1e-3, limits=Limits(other, effort=35.0), storage=False)
    )
    law.torque = np.array([90.0, -90.0])
    torque = control.step(0.0, shoulder.at([0.1, 0.2], [0.3, 0.4]), np.zeros(0), NOTHING)
    np.testing.assert_allclose(torque, [35.0, -35.0], atol=1e-9)
