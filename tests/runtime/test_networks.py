"""Packet faults in numbers, and the arm behind them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from phcontrol import ControlBox, InvalidArgumentError, PacketFaults
from phcontrol.runtime.simulated_arm import SimulatedArm
from tests.conftest import make_system

MANY = 20_000


def arrivals(network, times):
    """When each packet arrives, by its number, found in steps of a millisecond."""
    for number, t in enumerate(times):
        network.send(t, number)
    found = {}
    for k in range(int(1e3 * (times[-1] + 2.0))):
        for number in network.receive(1e-3 * k):
            found.setdefault(number, []).append(1e-3 * k)
    return found


def test_the_shares_lost_and_doubled_are_those_asked_for():
    """Binomial: within five standard deviations."""
    for loss, duplicates in [(0.3, 0.0), (0.0, 0.2), (0.4, 0.5)]:
        network = PacketFaults(loss=loss, duplicates=duplicates)
        for number in range(MANY):
            network.send(0.0, number)
        numbers = np.array(network.receive(0.0))
        kept, twice = len(set(numbers)), len(numbers) - len(set(numbers))
        assert abs(kept - (1.0 - loss) * MANY) <= 5.0 * np.sqrt(loss * (1.0 - loss) * MANY)
        assert abs(twice - duplicates * kept) <= 5.0 * np.sqrt(duplicates * (1.0 - duplicates) * kept)
    network = PacketFaults(loss=1.0)
    network.send(0.0, 1)
    assert network.receive(9.0) == []


def test_jitter_is_exponential_and_each_copy_has_its_own():
    network = PacketFaults(delay=0.25, jitter=0.125, duplicates=1.0)
    for number in range(MANY):
        network.send(1.0, number)
    assert network.receive(1.25) == []
    early = network.receive(1.25 + 0.125)
    assert len(early) / (2 * MANY) == pytest.approx(1.0 - np.exp(-1.0), abs=5.0 * 0.5 / np.sqrt(2 * MANY))
    both = 2 * len(early) - 2 * len(set(early))  # packets of which both copies are there: independently
    assert both / (2 * MANY) == pytest.approx((1.0 - np.exp(-1.0)) ** 2, abs=0.02)
    assert len(network.receive(100.0)) == 2 * MANY - len(early)


def test_what_is_sent_together_arrives_in_its_order_exactly_when_the_delay_has_passed():
    network = PacketFaults(delay=0.5)
    for number in range(5):
        network.send(0.25, number)
    network.send(0.0, "first")
    assert network.receive(0.5) == ["first"]
    assert network.receive(0.75 - 1e-9) == []
    assert network.receive(0.75) == [0, 1, 2, 3, 4]
    assert network.receive(0.75) == []


def test_an_outage_swallows_what_is_sent_in_it():
    network = PacketFaults(outages=[(1.0, 0.5), (3.0, 0.25)])
    sent = [0.999, 1.0, 1.25, 1.499, 1.5, 2.999, 3.0, 3.249, 3.25]
    for t in sent:
        network.send(t, t)
    assert network.receive(9.0) == [0.999, 1.5, 2.999, 3.25]


def test_the_same_seed_has_the_same_faults():
    def run(**seed):
        return arrivals(PacketFaults(loss=0.3, jitter=0.01, duplicates=0.3, **seed), [0.01 * k for k in range(50)])

    assert run() == run(seed=0) != run(seed=1) == run(seed=1)


@pytest.mark.parametrize(
    "arguments",
    [
        {"loss": 1.001},
        {"loss": -0.001},
        {"duplicates": 1.001},
        {"duplicates": -0.001},
        {"delay": -1e-9},
        {"jitter": -1e-9},
        {"outages": [(1.0, -0.1)]},
        {"outages": [(1.0,)]},
        {"outages": [(1.0, 2.0, 3.0)]},
        {"seed": -1},
    ],
)
def test_faults_out_of_their_domain_are_refused(arguments):
    with pytest.raises(InvalidArgumentError, match=next(iter(arguments)).removesuffix("s")):
        PacketFaults(**arguments)
    PacketFaults(loss=1.0, duplicates=1.0, delay=0.0, jitter=0.0, outages=[(-1.0, 0.0)])


def test_an_arm_behind_a_network_shows_the_newest_reading_and_its_age():
    """Readings late by two periods and a half; one that was overtaken shows no more."""
    system = make_system("pera_shoulder")
    box = ControlBox(system, period=0.01)
    arm = SimulatedArm(box, readings=PacketFaults(delay=0.025))
    ages = []
    for _ in range(6):
        reading = arm.read()
        ages.append(None if reading is None else round(reading.age, 9))
        arm.write(np.zeros(2))
    assert ages == [None, None, None, 0.03, 0.03, 0.03]

    class Shuffled(PacketFaults):
        """Delivers in the order told."""

        def __init__(self):
            super().__init__()
            self.kept, self.due = {}, iter([[0], [2], [1], [], [3]])

        def send(self, t, packet):
            self.kept[packet[0]] = packet

        def receive(self, t):
            return [self.kept[number] for number in next(self.due) if number in self.kept]

    arm = SimulatedArm(ControlBox(system, period=0.01), readings=Shuffled())
    arm.write(np.array([5.0, -5.0]))
    arm.write(np.array([5.0, -5.0]))
    shown = [arm.read() for _ in range(4)]
    assert [round(reading.age, 9) for reading in shown] == [0.02, 0.0, 0.0, 0.0]
    for one, other in itertools.pairwise(shown[1:]):
        np.testing.assert_array_equal(one.position, other.position)
    assert np.abs(shown[1].position - shown[0].position).max() > 0.0
