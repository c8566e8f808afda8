"""The external force of an arm without force sensors, told from its motion."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    ControlBox,
    ControlLoop,
    InvalidArgumentError,
    MechanicalSystem,
    MinimumJerk,
    MomentumObserver,
    ObservedArm,
    Reading,
    SimulatedArm,
    Sine,
    StribeckFriction,
    drive,
    load_robot,
    make_controller,
)
from tests.conftest import make_system
from tests.runtime.test_control_loop import PERIOD

GAIN = 100.0  # [1/s]
FREQUENCY = 0.5  # of the push [Hz]
PUSH = np.array([3.0, -4.0, 2.0, 2.0, 0.5, -0.5, 0.2])  # [N·m]


class OwnClock:
    """A simulated arm that is the clock, says what it was sent, and loses every seventh reading and torque."""

    pace = "read"

    def __init__(self, box):
        self.box, self.gravity, self.count, self.last = box, box.gravity, 0, np.zeros(box.system.n)

    def read(self):
        elapsed = PERIOD
        if self.count:
            self.box.advance()
        if self.count % 7 == 6:
            self.box.advance()
            elapsed += PERIOD
        self.count += 1
        position, velocity = self.box.reading()[:2]
        return Reading(position, velocity, torque=self.last, elapsed=elapsed)

    def write(self, torque):
        self.last = torque.copy()
        self.box.command(round(self.box.time / PERIOD), torque)


def observe(make_arm, gravity, model=None, friction=None):
    """Move a Panda that is pushed; return the estimates, and the push as a first-order filter of it shows it."""
    plant = (
        make_system("panda") if friction is None else MechanicalSystem(make_system("panda").robot, friction=friction)
    )
    model = plant if model is None else model
    start = plant.robot.home
    box = ControlBox(plant, period=PERIOD, gravity=gravity, disturbance=Sine(PUSH, FREQUENCY))
    goal = start + 0.3 * np.sign(1e-3 - start)
    law = make_controller("energy_shaping", plant, goal, reference=MinimumJerk.within_limits(plant.robot, start, goal))
    loop = ControlLoop(plant, law, PERIOD, clock=lambda: box.time, deadline=1.0)
    arm = ObservedArm(make_arm(box), MomentumObserver(model, GAIN), clock=lambda: box.time)
    found, times = [], []

    def note(t, reading, torque):
        found.append(reading.measured.external_force)
        total = model.at(reading.position, reading.velocity).total_force(reading.measured.external_force)
        np.testing.assert_allclose(reading.measured.total_force, total, rtol=1e-12, atol=1e-12)
        times.append(box.time)

    drive(loop, arm, 2.0, each_step=note)
    assert loop.fault is None
    # K ∫ exp(−K(t − s)) sin(ω s) ds, in closed form
    t, w = np.array(times), 2.0 * np.pi * FREQUENCY
    lagged = GAIN * (GAIN * np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-GAIN * t)) / (GAIN**2 + w**2)
    return np.array(found), np.outer(lagged, PUSH)


@pytest.mark.parametrize("gravity", ["robot", "controller"])
@pytest.mark.parametrize("make_arm", [SimulatedArm, OwnClock])
def test_the_estimate_is_the_push_seen_through_a_first_order_filter(make_arm, gravity):
    """Also of an arm that adds its own weight, has a clock of its own and loses readings."""
    found, pushed = observe(make_arm, gravity)
    np.testing.assert_allclose(found, pushed, atol=0.02)  # N·m, of 4: modeled forces are averaged over a period


def test_friction_that_the_model_has_is_no_external_force():
    """And friction that it does not have is one."""
    # the wrist's joints of some g m² turn back within a period under dry friction, which no reading shows
    rubbing = StribeckFriction(viscous=1.0, coulomb=[1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    found, pushed = observe(SimulatedArm, "robot", friction=rubbing)
    np.testing.assert_allclose(found, pushed, atol=0.1)
    fooled, _ = observe(SimulatedArm, "robot", model=make_system("panda"), friction=rubbing)
    assert np.abs(fooled - pushed).max() > 0.9


def test_a_reading_that_is_read_twice_changes_nothing():
    """An arm that has no newer reading shows the last one, older."""
    system = MechanicalSystem(load_robot("pera_shoulder"))
    now = [0.0]
    reading = [Reading(np.zeros(2), np.zeros(2))]

    class Arm:
        gravity, pace = "controller", "clock"

        def read(self):
            return reading[0]

        def write(self, torque):
            pass

    arm = ObservedArm(Arm(), MomentumObserver(system, GAIN), clock=lambda: now[0])
    np.testing.assert_array_equal(arm.read().measured.external_force, 0.0)
    arm.write(np.zeros(2))
    now[0], reading[0] = 1e-3, Reading(np.zeros(2), np.array([0.1, 0.0]))
    first = arm.read().measured.external_force
    assert np.abs(first).max() > 0.1
    now[0], reading[0] = 2e-3, reading[0]._replace(age=1e-3)
    np.testing.assert_array_equal(arm.read().measured.external_force, first)
    reading[0] = None
    assert arm.read() is None


def test_bad_input():
    """What is no observer, one with a period, and what is no clock."""
    system = make_system("pera_shoulder")
    arm = SimulatedArm(ControlBox(system))
    with pytest.raises(InvalidArgumentError, match="observer"):
        ObservedArm(arm, 50.0)
    with pytest.raises(InvalidArgumentError, match=r"observer.*period"):
        ObservedArm(arm, MomentumObserver(system, period=1e-2))
    with pytest.raises(InvalidArgumentError, match="clock"):
        ObservedArm(arm, MomentumObserver(system), clock=3.0)
