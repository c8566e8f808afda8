"""Drivers: packets, faults, the box's watchdog, and the arm in another process."""

from __future__ import annotations

import runpy
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import ControlBox, InvalidArgumentError, MechanicalSystem, PacketFaults, UdpArm, drive, load_robot
from phcontrol.simulation.udp_arm import pack, unpack

EXAMPLES = Path(__file__).parents[2] / "examples"


@given(st.binary(max_size=200))
def test_packets_that_are_not_ours_are_refused(content):
    result = unpack(content, 2, 3)
    assert result is None or (content[:4] == b"phct" and len(content) == 64)


@given(st.integers(0, 2**62), st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6))
def test_packets_arrive_as_they_were_sent(number, values):
    vectors = np.array(values).reshape(3, 2)
    found_number, found = unpack(pack(number, *vectors), 2, 3)
    assert found_number == number
    np.testing.assert_array_equal(found, vectors)
    for other in ((3, 3), (2, 2)):
        assert unpack(pack(number, *vectors), *other) is None
    assert unpack(pack(number, *vectors)[:-1], 2, 3) is None
    assert unpack(b"PHCT" + pack(number, *vectors)[4:], 2, 3) is None
    vectors[1, 1] = np.nan
    assert unpack(pack(number, *vectors), 2, 3) is None


def test_a_network_loses_duplicates_and_reorders_as_asked():
    network = PacketFaults(loss=0.2, delay=0.01, jitter=0.02, duplicates=0.1, outages=[(5.0, 1.0)], seed=3)
    arrived = []
    for k in range(10_000):
        network.send(k * 1e-3, k)
        arrived += [(k * 1e-3, packet) for packet in network.receive(k * 1e-3)]
    counts = Counter(packet for _, packet in arrived)
    assert not [packet for packet in counts if 5000 <= packet < 6000]
    assert len(counts) / 9000 == pytest.approx(0.8, abs=0.02)
    assert sum(number == 2 for number in counts.values()) / len(counts) == pytest.approx(0.1, abs=0.02)
    delays = np.array([t - packet * 1e-3 for t, packet in arrived])
    assert delays.min() >= 0.01
    assert delays.mean() == pytest.approx(0.03, rel=0.05)
    order = [packet for _, packet in arrived]
    assert order != sorted(order)


def test_a_perfect_network_is_perfect_and_bad_arguments_are_refused():
    network = PacketFaults()
    network.send(0.0, "a")
    network.send(0.0, "b")
    assert network.receive(0.0) == ["a", "b"]
    for arguments in ({"loss": 1.5}, {"delay": -1.0}, {"duplicates": -0.1}, {"outages": [(0.0, -1.0)]}):
        with pytest.raises(InvalidArgumentError):
            PacketFaults(**arguments)


def test_the_box_uses_newer_finite_commands_only_and_clips_them(shoulder):
    box = ControlBox(shoulder)
    assert box.command(3, np.array([1.0, 2.0]))
    for number, torque in ((3, [5.0, 5.0]), (2, [5.0, 5.0]), (4, [np.nan, 0.0]), (5, [1.0])):
        assert not box.command(number, np.array(torque))
    np.testing.assert_array_equal(box._torque, [1.0, 2.0])
    assert box.command(6, np.array([1e9, -1e9]))
    np.testing.assert_array_equal(box._torque, [40.0, -40.0])
    assert box.counts == {"accepted": 2, "refused": 4, "braking": 0}


def test_the_box_brakes_by_itself_after_its_patience(shoulder):
    box = ControlBox(shoulder, patience=0.02, position=[-0.5, 0.3])
    box.command(0, np.array([30.0, -30.0]))
    speeds = []
    for _ in range(500):
        box.advance()
        speeds.append(np.abs(box.reading().velocity).max())
    assert np.argmax(speeds) in (18, 19, 20, 21)  # it speeds up for 20 ms, and no longer
    assert speeds[-1] < 1e-3 * max(speeds)
    assert box.counts["braking"] == pytest.approx(480, abs=2)


def make_shoulder():
    return MechanicalSystem(load_robot("pera_shoulder"))


@pytest.mark.xdist_group("udp")
def test_an_arm_in_another_process_answers(shoulder):
    """One second over UDP with faults: readings come, torques have an effect, nothing malformed."""
    from phcontrol import ControlLoop, make_controller

    law = make_controller("energy_shaping", shoulder, [0.3, -0.3])
    loop = ControlLoop(shoulder, law, 5e-3, start_time=0.1, stale_after=1.0, deadline=1.0)
    faults = {"loss": 0.05, "jitter": 1e-3, "duplicates": 0.05}
    with UdpArm(make_shoulder, duration=60.0, period=2e-3, faults=faults) as arm:
        first = arm.read()
        drive(loop, arm, 1.0)
        last = arm.read()
    assert arm.counts["readings"] > 20
    assert arm.counts["malformed"] == 0
    distance = [np.abs(reading.position - [0.3, -0.3]).max() for reading in (first, last)]
    assert distance[1] < 0.5 * distance[0]


def test_the_udp_arm_refuses_bad_arguments_before_it_starts():
    with pytest.raises(InvalidArgumentError, match="duration"):
        UdpArm(make_shoulder, duration=0.0)
    with pytest.raises(InvalidArgumentError, match="loss"):
        UdpArm(make_shoulder, duration=1.0, faults={"loss": 2.0})


@pytest.mark.xdist_group("udp")
def test_the_hardware_example_runs(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["hardware_loop.py", "--seconds", "1.0"])
    runpy.run_path(str(EXAMPLES / "hardware_loop.py"), run_name="__main__")
    printed = capsys.readouterr().out
    assert "modes: STARTING" in printed
    assert "'malformed': 0" in printed
    assert "steps: computing" in printed
