"""The small rules that a loop goes by, beside what they are said to be: restarts, borders, packets, starts, heads."""

from __future__ import annotations

import hashlib
import os
import struct
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from phcontrol import DataFileError, InvalidArgumentError, PacketFaults, PHControlError, preflight, read_loop_log
from phcontrol.runtime import preflight as module
from phcontrol.runtime.restart_policy import RestartPolicy
from phcontrol.runtime.signal_border import SignalBorder
from phcontrol.runtime.start_check import StartCheck
from phcontrol.runtime.timing import TimingRecorder


def test_restarts_wait_twice_as_long_each_time_and_give_up():
    """0.1 s of good readings, then 0.2, 0.4, 0.8, 1.6 s; the sixth stop in a row is the last."""
    period = 1e-3
    policy = RestartPolicy(period)
    assert policy.recovery_time == pytest.approx(0.1)
    assert not policy.is_ready  # nothing good was seen yet
    for k in range(5):
        assert policy.note_stop() == ""
        wait = 0.1 * 2.0**k
        assert policy.recovery_time == pytest.approx(wait)
        steps = round(wait / period)
        for step in range(steps):
            assert not policy.is_ready, step
            policy.note_waiting(True, period)
        assert policy.is_ready
        policy.note_waiting(False, period)  # one that is not good, and all is to be waited for again
        assert not policy.is_ready
    assert policy.note_stop() == "gave up after 6 stops"
    policy.reset()
    assert policy.recovery_time == pytest.approx(0.1)
    assert policy.note_stop() == ""


def test_running_for_ten_seconds_makes_up_for_a_stop():
    policy = RestartPolicy(0.01)
    for _ in range(3):
        policy.note_stop()
    assert policy.recovery_time == pytest.approx(0.4)
    for _ in range(1000):
        policy.note_running()
    assert policy.recovery_time == pytest.approx(0.2)
    for _ in range(3000):
        policy.note_running()
    assert policy.recovery_time == pytest.approx(0.1)
    for _ in range(5):
        assert policy.note_stop() == ""
    assert policy.note_stop() == "gave up after 6 stops"  # counted from when none was left


def test_good_readings_that_do_not_come_end_the_waiting():
    policy = RestartPolicy(0.1)
    policy.note_stop()
    for _ in range(100):
        policy.note_waiting(False, 0.1)
    assert policy.complaint == ""
    policy.note_waiting(False, 0.2)
    assert policy.complaint == "gave up: not 0.1 s of good readings in 10.2 s"
    policy.note_stop()
    assert policy.complaint == ""
    policy.reset()
    policy.note_waiting(False, 10.05)
    assert policy.complaint == ""


@pytest.mark.parametrize(("cores", "well"), [(1, False), (2, False), (3, True), (4, True)])
def test_three_cores_are_enough(cores, well, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda who: set(range(cores)), raising=False)
    (found,) = (finding for finding in module.examine(1e-3, tmp_path) if finding.name == "cores")
    assert found.is_well == well


@pytest.mark.parametrize(("step", "well"), [(0.9e-5, True), (1.1e-5, False), (5e-4, False)])
def test_a_clock_must_resolve_a_hundredth_of_the_period(step, well, tmp_path, monkeypatch):
    monkeypatch.setattr(module.time, "get_clock_info", lambda name: SimpleNamespace(resolution=step))
    (found,) = (finding for finding in module.examine(1e-3, tmp_path) if finding.name == "clock")
    assert found.is_well == well
    assert f"steps of {1e9 * step:g} ns" in str(found)


@pytest.mark.parametrize(("load", "well"), [(1.9, True), (2.1, False)])
def test_half_of_the_cores_may_be_busy(load, well, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    monkeypatch.setattr(os, "getloadavg", lambda: (load, 4.0 - load, 4.0 - load), raising=False)
    (found,) = (finding for finding in module.examine(1e-3, tmp_path) if finding.name == "load")
    assert found.is_well == well


def test_a_trial_is_of_a_hundred_periods_at_least():
    with pytest.raises(InvalidArgumentError, match=r"duration: must be >= 0.1"):
        preflight(1e-3, 0.0995)
    assert preflight(1e-4, 0.01).periods == 100


def test_packets_arrive_once_unless_they_are_doubled():
    plain, doubled = PacketFaults(), PacketFaults(duplicates=1.0)
    for network, times in ((plain, 1), (doubled, 2)):
        for k in range(5):
            network.send(0.1 * k, k)
        assert network.receive(1.0) == [k for k in range(5) for _ in range(times)]
        assert network.receive(1.0) == []
    lost = PacketFaults(loss=1.0)
    lost.send(0.0, "x")
    assert lost.receive(9.0) == []
    late = PacketFaults(delay=0.5, outages=[(1.0, 0.5)])
    for t in (0.0, 1.0, 1.49, 1.5):
        late.send(t, t)
    assert late.receive(0.49) == []
    assert late.receive(0.5) == [0.0]
    assert late.receive(9.0) == [1.5]


@pytest.mark.parametrize(("margin", "said"), [(0.0, ""), (1e-9, ""), (-2.0, "of 5 J, and safe ones have at most 3 J")])
def test_a_start_outside_the_safe_set_is_refused_or_warned_of(margin, said):
    law, x = object(), SimpleNamespace(position=0.0, velocity=0.0)
    safe = SimpleNamespace(controller=law, level=3.0, binding="torque", margin=lambda q, v, z: margin)
    if not said:
        StartCheck(safe, law, "refuse").check(x, np.zeros(0))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            StartCheck(safe, law, "warn").check(x, np.zeros(0))
        return
    with pytest.raises(PHControlError, match=said):
        StartCheck(safe, law, "refuse").check(x, np.zeros(0))
    with pytest.warns(UserWarning, match=said):
        StartCheck(safe, law, "warn").check(x, np.zeros(0))
    StartCheck(None, law, "refuse").check(x, np.zeros(0))
    with pytest.raises(InvalidArgumentError, match=r"safe_set: must be the safe_set\(\) of this very law"):
        StartCheck(safe, object(), "refuse")


@pytest.mark.parametrize(
    ("length", "width", "rows"),
    [(2**20 + 1, 10, 10), (10, 0, 10), (10, 2**16, 10), (10, 70_000, 10), (10, 10, 0), (10, 10, 2**40)],
)
def test_a_head_of_a_loops_log_that_makes_no_sense_is_refused(tmp_path, length, width, rows):
    """With a hash that fits it: it is refused for what it says, before anything is made room for."""
    text = b"{" + b" " * (length - 2) + b"}"
    plain = struct.pack("<8sQQQ", b"phcloop2", length, width, rows)
    head = plain + hashlib.sha256(plain + text).digest()
    path = tmp_path / "forged.loop"
    path.write_bytes(head + text)
    with pytest.raises(DataFileError, match="its head makes no sense"):
        read_loop_log(path)
    path.write_bytes(head[:-1])
    with pytest.raises(DataFileError, match="not the log of a control loop"):
        read_loop_log(path)


def test_a_signal_at_its_bounds_makes_sense_and_is_taken_over_if_it_is_newer():
    border = SignalBorder(np.array([-1.0]), np.array([2.0]), lambda value, last, seconds: False)
    for bound in (-1.0, 2.0):
        assert border.offer(np.array([bound]), 0.0)
        assert border.value == bound
        border.elapse(1e-3)
    for beyond in (np.nextafter(-1.0, -2.0), np.nextafter(2.0, 3.0)):
        assert not border.offer(np.array([beyond]), 0.0)
    assert border.value == 2.0
    assert border.offer(np.array([0.5]), 1e-3)  # as old as the one that is there
    assert border.value == 2.0
    assert border.offer(np.array([0.5]), 0.9e-3)
    assert border.value == 0.5
    border.forget()
    assert (border.value, border.age, border.rejected_in_a_row) == (None, np.inf, 0)


def test_before_the_first_step_none_has_taken_any_time():
    recorder = TimingRecorder(1e-3, 1e-3)
    assert recorder.last == 0.0
    recorder.begin(5.0)
    recorder.end(5.25)
    assert recorder.last == 0.25
