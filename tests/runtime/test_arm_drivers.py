"""Drivers: packets, faults, the box's watchdog, and the arm in another process."""

from __future__ import annotations

import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import (
    ControlBox,
    InvalidArgumentError,
    MechanicalSystem,
    PacketFaults,
    Reading,
    SimulatedArm,
    UdpArm,
    drive,
    load_robot,
)
from phcontrol.runtime.udp_arm import pack, unpack

EXAMPLES = Path(__file__).parents[2] / "examples"
TOKEN = bytes(range(16))


@given(st.binary(max_size=200))
def test_packets_that_are_not_ours_are_refused(content):
    assert unpack(TOKEN, content, 2, 3) is None  # without the token nothing is


def test_a_packet_with_another_token_is_refused():
    packet = pack(bytes(16), 0, 0.0, *np.zeros((3, 2)))
    assert unpack(bytes(16), packet, 2, 3) is not None
    assert unpack(TOKEN, packet, 2, 3) is None


@given(st.integers(0, 2**62), st.floats(0, 1e9), st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6))
def test_packets_arrive_as_they_were_sent(number, moment, values):
    vectors = np.array(values).reshape(3, 2)
    packet = pack(TOKEN, number, moment, *vectors)
    found = unpack(TOKEN, packet, 2, 3)
    assert (found.number, found.time) == (number, moment)
    np.testing.assert_array_equal(found.vectors, vectors)
    for other in ((3, 3), (2, 2)):
        assert unpack(TOKEN, packet, *other) is None
    assert unpack(TOKEN, packet[:-1], 2, 3) is None
    assert unpack(TOKEN, b"PHCT" + packet[4:], 2, 3) is None
    assert unpack(TOKEN, pack(TOKEN, number, np.nan, *vectors), 2, 3) is None
    vectors[1, 1] = np.nan
    assert unpack(TOKEN, pack(TOKEN, number, moment, *vectors), 2, 3) is None


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


def test_a_number_from_nowhere_does_not_lock_the_sender_out(shoulder):
    box = ControlBox(shoulder)
    assert not box.command(2**63 - 1, np.zeros(2))
    assert box.command(0, np.zeros(2))
    assert not box.command(2**40, np.zeros(2))
    assert box.command(1, np.zeros(2))
    for _ in range(5000):  # an outage of 5 s, in which the sender went on counting
        box.advance()
    assert box.command(5001, np.zeros(2))


def test_what_is_not_a_torque_is_no_command(shoulder):
    box = ControlBox(shoulder)
    for torque in (np.zeros(2) + 1j, np.zeros((2, 1)), np.array(["1", "2"]), None, 3.0, np.zeros(2, dtype=bool)):
        assert not box.command(0, torque)
    assert box.command(0, np.zeros(2))


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


@pytest.mark.xdist_group("udp")
def test_packets_of_others_do_not_move_the_arm():
    """Whoever finds the port sends the largest torque and the largest number, with a token of his own and none."""
    with UdpArm(make_shoulder, duration=60.0, period=2e-3) as arm, socket.socket(type=socket.SOCK_DGRAM) as other:
        start = arm.read()
        for k in range(200):
            for packet in (
                pack(bytes(16), 2**63 - 1, 0.0, np.full(2, 40.0)),
                pack(bytes(16), k, 0.0, np.full(2, 40.0)),
            ):
                other.sendto(packet, arm._peer)
                other.sendto(packet[:16] + packet[40:], arm._peer)  # without time and token
            other.sendto(pack(bytes(16), 2**62, 0.0, *np.full((3, 2), 0.5)), arm._socket.getsockname())
            time.sleep(1e-3)
        between = arm.read()
        for _ in range(100):
            arm.write(np.array([5.0, -5.0]))
            time.sleep(2e-3)
        end = arm.read()
    assert np.abs(between.position - start.position).max() < 1e-3
    assert np.abs(end.position - start.position).max() > 1e-2  # the sender is not locked out
    assert arm.counts["malformed"] > 0


@pytest.mark.xdist_group("udp")
def test_a_reading_that_waited_in_the_socket_is_as_old_as_it_is():
    """A process that was stopped finds old packets; they were taken for fresh ones."""
    with UdpArm(make_shoulder, duration=60.0, period=2e-3) as arm:
        arm.read()
        time.sleep(0.1)  # packets come, and nobody looks
        arm._process.terminate()
        arm._process.join()
        time.sleep(0.2)
        reading = arm.read()
    assert reading.age >= 0.2


@pytest.mark.xdist_group("udp")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_arms_process_does_not_outlive_the_one_that_started_it(number, tmp_path):
    program = tmp_path / "program.py"
    program.write_text(
        "import time\n"
        "from phcontrol import UdpArm\n"
        "from tests.runtime.test_arm_drivers import make_shoulder\n"
        "if __name__ == '__main__':\n"
        "    with UdpArm(make_shoulder, duration=600.0) as arm:\n"
        "        print(arm._process.pid, flush=True)\n"
        "        time.sleep(600.0)\n"
    )
    root = str(Path(__file__).parents[2])
    parent = subprocess.Popen(
        [sys.executable, program], stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": root}
    )
    box = psutil.Process(int(parent.stdout.readline()))
    parent.send_signal(number)
    parent.wait()
    parent.stdout.close()
    for _ in range(3000):  # it would have gone on for 600 s
        if not box.is_running() or box.status() == psutil.STATUS_ZOMBIE:
            return
        time.sleep(0.01)
    box.kill()
    pytest.fail("the arm's process goes on without the one that started it")


def test_a_driver_may_do_anything_with_a_torque_and_have_no_reading_at_times(shoulder):
    """What is logged is what was sent, and a reading that fails to come once is not a command of zero torque."""
    from phcontrol import ControlLoop, make_controller

    box = ControlBox(shoulder)
    plain = SimulatedArm(box)

    class Driver:
        gravity, pace = "controller", "write"
        reads = 0

        def read(self):
            self.reads += 1
            return None if self.reads == 20 else plain.read()

        def write(self, torque):
            plain.write(torque)
            torque *= np.nan

    loop = ControlLoop(shoulder, make_controller("energy_shaping", shoulder), 1e-3, clock=lambda: box.time)
    torques = []
    drive(loop, Driver(), 0.05, each_step=lambda t, reading, torque: torques.append(torque))
    assert np.isfinite(torques).all()
    assert len(torques) == 50
    assert np.abs(np.diff(torques, axis=0)).max() < 0.5
    assert loop.counts["stops"] == 0


def test_missed_periods_are_not_made_up_for(shoulder, monkeypatch):
    """Each period has one step at most: two in one would advance the law's state twice."""
    from phcontrol import ControlLoop, make_controller
    from phcontrol.runtime import arm_driver

    class Time:
        now = 0.0

        def perf_counter(self):
            return self.now

        def sleep(self, seconds):
            self.now += seconds + (2.4e-3 if round(self.now * 1e3) % 5 == 0 else 0.0)  # the scheduler is late at times

    clock, begins, box = Time(), [], ControlBox(shoulder)
    monkeypatch.setattr(arm_driver, "time", clock)

    class Driver:
        gravity, pace = "controller", "clock"

        def read(self):
            begins.append(clock.now)
            clock.now += 1e-4
            return box.reading()

        def write(self, torque):
            clock.now += 1e-4

    loop = ControlLoop(shoulder, make_controller("energy_shaping", shoulder), 1e-3, clock=clock.perf_counter)
    monkeypatch.setattr(arm_driver, "wait_until", lambda moment: clock.sleep(max(0.0, moment - clock.now)))
    drive(loop, Driver(), 0.1)
    periods = np.floor(np.array(begins) / 1e-3 + 1e-9)
    assert (np.diff(periods) >= 1).all()
    assert loop.timing.steps + loop.timing.skipped == pytest.approx(100, abs=3)
    assert loop.timing.skipped > 20


def test_an_arm_that_is_gone_leaves_the_last_reading_which_grows_older():
    """What a socket says, on the next call, of packets that nobody took."""
    arm = UdpArm(make_shoulder, duration=1.0)
    assert arm.counts == {"readings": 0, "old": 0, "malformed": 0}

    def gone(size):
        raise ConnectionRefusedError(111, "Connection refused")

    arm._socket = SimpleNamespace(recvfrom=gone)
    assert arm.read() is None
    arm._newest, arm._made = Reading(np.ones(2), np.zeros(2)), time.perf_counter() - 5.0
    reading = arm.read()
    np.testing.assert_array_equal(reading.position, np.ones(2))
    assert reading.age >= 5.0


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


@pytest.mark.xdist_group("udp")
def test_a_process_that_is_stopped_in_mid_motion_leaves_an_arm_that_brakes_by_itself(tmp_path):
    """SIGSTOP of the loop's process, and SIGCONT: the box's watchdog ended the torque, and the loop starts again."""
    program = tmp_path / "program.py"
    program.write_text(
        "import json, os, signal, sys\n"
        "import numpy as np\n"
        "from phcontrol import ControlLoop, UdpArm, drive, make_controller\n"
        "from tests.runtime.test_arm_drivers import make_shoulder\n"
        "if __name__ == '__main__':\n"
        "    system = make_shoulder()\n"
        "    law = make_controller('energy_shaping', system, [1.0, -0.4])\n"
        "    loop = ControlLoop(system, law, 5e-3, start_time=0.0, stale_after=0.1, deadline=1.0)\n"
        "    speeds, modes = [], []\n"
        "    def note(t, reading, torque):\n"
        "        speeds.append(float(np.abs(reading.velocity).max()))\n"
        "        modes.append(loop.mode.name)\n"
        "        if len(speeds) > 5 and speeds[-1] > 0.3 and 'STOPPING' not in modes and len(stopped) == 0:\n"
        "            stopped.append(len(speeds))\n"
        "            os.kill(os.getpid(), signal.SIGSTOP)\n"
        "    stopped = []\n"
        "    with UdpArm(make_shoulder, duration=60.0, period=2e-3) as arm:\n"
        "        drive(loop, arm, 2.0, each_step=note)\n"
        "    print(json.dumps({'speeds': speeds, 'modes': modes, 'stopped': stopped}))\n"
    )
    root = str(Path(__file__).parents[2])
    child = subprocess.Popen(
        [sys.executable, program], stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": root}
    )
    process = psutil.Process(child.pid)
    for _ in range(6000):
        if process.status() == psutil.STATUS_STOPPED:
            break
        time.sleep(0.01)
    time.sleep(1.0)
    child.send_signal(signal.SIGCONT)
    found = json.loads(child.communicate(timeout=120)[0])
    assert len(found["stopped"]) == 1
    moment = found["stopped"][0]
    assert found["speeds"][moment - 1] > 0.3
    assert found["speeds"][moment] < 0.05 * found["speeds"][moment - 1]  # the next reading: the arm stands
    assert "STOPPING" in found["modes"][moment:]
