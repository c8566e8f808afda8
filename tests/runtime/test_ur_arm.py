"""The UR driver against a stand-in of ur_rtde, at 500 Hz: no hardware and no simulator of it was at hand."""

from __future__ import annotations

import sys
import types

import numpy as np
import pytest

from phcontrol import (
    ArmError,
    ControlLoop,
    InvalidArgumentError,
    LoopMode,
    PHControlError,
    URArm,
    make_controller,
)
from phcontrol.simulation.integrators import runge_kutta_step
from tests.conftest import make_system
from tests.runtime.test_control_loop import Clock

PERIOD = 2e-3


class World:
    """A UR5 that adds its weight, and what its client was asked."""

    def __init__(self):
        self.system = make_system("ur5")
        self.state = np.concatenate([self.system.robot.home, np.zeros(6)])
        self.sent, self.steps, self.mode, self.calls = np.zeros(6), 0, 7, []
        self.protective, self.takes, self.answers = False, True, True

    def advance(self):
        def rate(t, y):
            x = self.system.at(y[:6], y[6:])
            return np.concatenate([x.velocity, x.acceleration(self.sent + x.gravity, None)])

        self.state = runge_kutta_step(rate, 0.0, self.state, PERIOD, rate(0.0, self.state))
        self.steps += 1


@pytest.fixture
def world(monkeypatch):
    """What stands in for ur_rtde's two modules."""
    world = World()

    class Receive:
        def __init__(self, address, frequency):
            if not world.answers:
                raise RuntimeError("Timeout connecting to RTDE")
            assert frequency == pytest.approx(500.0)

        getRobotMode = staticmethod(lambda: world.mode)  # noqa: N815
        getTimestamp = staticmethod(lambda: world.steps * PERIOD)  # noqa: N815
        getActualQ = staticmethod(lambda: world.state[:6].tolist())  # noqa: N815
        getActualQd = staticmethod(lambda: world.state[6:].tolist())  # noqa: N815
        isProtectiveStopped = staticmethod(lambda: world.protective)  # noqa: N815
        isEmergencyStopped = staticmethod(lambda: False)  # noqa: N815

        def disconnect(self):
            world.calls.append("receive ended")

    class Control:
        def __init__(self, address, frequency):
            pass

        def setWatchdog(self, rate):
            world.calls.append(f"watchdog {rate}")

        def kickWatchdog(self):
            world.calls.append("kick")

        def directTorque(self, torque, viscous, coulomb):
            assert all(type(x) is float for x in torque + viscous + coulomb)
            assert len(torque) == len(viscous) == len(coulomb) == 6
            world.sent, world.scales = np.array(torque), (viscous, coulomb)
            return world.takes

        def stopScript(self):
            world.calls.append("stopped")

        def disconnect(self):
            world.calls.append("control ended")

    for name, attribute, value in (
        ("rtde_receive", "RTDEReceiveInterface", Receive),
        ("rtde_control", "RTDEControlInterface", Control),
    ):
        module = types.ModuleType(name)
        setattr(module, attribute, value)
        monkeypatch.setitem(sys.modules, name, module)
    return world


def test_a_law_moves_the_arm_and_the_watchdog_is_kicked_with_each_torque(world):
    system, clock = world.system, Clock()
    goal = np.clip(system.robot.home + 0.2, system.robot.lower + 0.1, system.robot.upper - 0.1)
    loop = ControlLoop(
        system, make_controller("energy_shaping", system, goal), PERIOD, start_time=0.1, gravity="robot", clock=clock
    )
    with URArm("robot", system, clock=clock, viscous_scale=0.5) as arm:
        assert (arm.gravity, arm.pace, arm.period) == ("robot", "clock", PERIOD)
        for _ in range(2000):
            reading = arm.read()
            arm.write(loop.step(reading.position, reading.velocity, age=reading.age, torque=reading.torque))
            clock.now += PERIOD
            world.advance()
    assert loop.mode == LoopMode.RUNNING, loop.reason
    np.testing.assert_allclose(world.state[:6], goal, atol=2e-3)
    assert world.scales == ([0.5] * 6, [0.0] * 6)
    assert world.calls[0] == "watchdog 50.0"
    assert world.calls.count("kick") == 2000
    assert world.calls[-3:] == ["stopped", "control ended", "receive ended"]


def test_a_reading_that_does_not_change_grows_older(world):
    clock = Clock()
    with URArm("robot", world.system, clock=clock) as arm:
        assert arm.read().age == 0.0
        clock.now += 0.05
        assert arm.read().age == pytest.approx(0.05)
        world.advance()
        assert arm.read().age == 0.0


def test_a_robot_that_stopped_or_takes_no_torque_is_an_error(world):
    with URArm("robot", world.system) as arm:
        world.protective = True
        with pytest.raises(ArmError, match="stopped .protective"):
            arm.read()
        world.takes = False
        with pytest.raises(ArmError, match="did not take a torque"):
            arm.write(np.zeros(6))
    with pytest.raises(ArmError, match="not under control"):
        arm.read()
    with pytest.raises(ArmError, match="not under control"):
        arm.write(np.zeros(6))


def test_a_robot_that_is_off_or_not_there_is_said_so(world):
    world.mode = 5
    with pytest.raises(ArmError, match=r"is idle \(its brakes are on\), not running"):
        URArm("robot", world.system).__enter__()
    world.mode = -1
    with pytest.raises(ArmError, match="is no controller, not running"):
        URArm("robot", world.system).__enter__()
    world.answers = False
    with pytest.raises(ArmError, match="no robot answers at 10.0.0.9: Timeout"):
        URArm("10.0.0.9", world.system).__enter__()


def test_another_arm_is_refused(world):
    with pytest.raises(
        InvalidArgumentError, match="must have the joints shoulder_pan_joint, .* in this order, but has"
    ):
        URArm("robot", make_system("panda"))
    with pytest.raises(InvalidArgumentError, match="viscous_scale: must be 0 to 1"):
        URArm("robot", world.system, viscous_scale=2.0)


def test_without_its_client_it_is_said_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "rtde_control", None)
    with pytest.raises(PHControlError, match=r"pip install 'phcontrol\[ur\]'"):
        URArm("robot", make_system("ur5"))
