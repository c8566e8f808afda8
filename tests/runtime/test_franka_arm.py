"""The Franka driver against a stand-in for its maker's client: what is sent, what is refused, and what stops it."""

from __future__ import annotations

import sys
import types
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from phcontrol import (
    ArmError,
    ControlLoop,
    FrankaArm,
    InvalidArgumentError,
    Limits,
    LoopMode,
    MechanicalSystem,
    PHControlError,
    TorqueFilter,
    drive,
    load_robot,
    make_controller,
)
from phcontrol.runtime import franka_arm
from phcontrol.simulation.integrators import runge_kutta_step
from tests.conftest import make_system

PERIOD = 1e-3


class Torques:
    def __init__(self, torques):
        assert all(type(torque) is float for torque in torques)
        assert len(torques) == 7
        self.torques, self.motion_finished = torques, False


class Errors:
    def __init__(self, names=()):
        self.names = list(names)

    def __bool__(self):
        return bool(self.names)

    def __str__(self):
        return str(self.names)


class Robot:
    """A Panda that adds its weight, in steps of 1 ms; it stops by a reflex when the torque jumps."""

    system = make_system("panda")
    mode, errors, reflex_at, load, lost, refuses = "Idle", (), None, 0.0, {}, None

    def __init__(self, address, config):
        if self.refuses is not None:
            raise self.refuses
        self.config, self.time = config, 0.0
        self.state = np.concatenate([self.system.robot.home, np.zeros(7)])
        self.sent, self.finished, self.stopped, self.collision = np.zeros(7), False, False, None
        Robot.last = self

    def read_once(self):
        q, v = self.state[:7], self.state[7:]
        weight = self.system.at(q).gravity
        return SimpleNamespace(
            q=q.tolist(),
            dq=v.tolist(),
            tau_J=(self.sent + weight + self.load).tolist(),
            tau_J_d=self.sent.tolist(),
            tau_ext_hat_filtered=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0],
            robot_mode=f"RobotMode.{self.mode}",
            current_errors=Errors(self.errors),
        )

    def automatic_error_recovery(self):
        type(self).recovered = True
        self.mode, self.errors = "Idle", ()

    def set_collision_behavior(self, *thresholds):
        self.collision = thresholds

    def start_torque_control(self):
        return Control(self)

    def stop(self):
        self.stopped = True


class Control:
    def __init__(self, robot):
        self.robot, self.reads = robot, 0

    def readOnce(self):
        robot = self.robot
        self.reads += 1
        steps = 0 if self.reads == 1 else robot.lost.get(self.reads, 1)
        for _ in range(steps):
            self.advance()
        if robot.reflex_at == self.reads:
            raise RuntimeError(
                'libfranka: Move command aborted: motion aborted by reflex! ["joint_velocity_violation"]\n'
                "control_command_success_rate: 1"
            )
        return robot.read_once(), SimpleNamespace(to_sec=lambda: steps * PERIOD)

    def writeOnce(self, torques):
        change = np.abs(np.array(torques.torques) - self.robot.sent).max()
        if change > 1.0:
            raise RuntimeError('motion aborted by reflex! ["controller_torque_discontinuity"]')
        self.robot.sent, self.robot.finished = np.array(torques.torques), torques.motion_finished

    def advance(self):
        robot, system = self.robot, self.robot.system

        def rate(t, y):
            x = system.at(y[:7], y[7:])
            return np.concatenate([x.velocity, x.acceleration(robot.sent + x.gravity, None)])

        robot.state = runge_kutta_step(rate, 0.0, robot.state, PERIOD, rate(0.0, robot.state))
        robot.time += PERIOD


@pytest.fixture
def franka(monkeypatch):
    """A module in place of pylibfranka, and a robot of one's own to change."""
    robot = type("Robot", (Robot,), {"recovered": False})
    module = types.ModuleType("pylibfranka")
    module.Robot, module.Torques = robot, Torques
    module.RealtimeConfig = SimpleNamespace(kEnforce="enforce", kIgnore="ignore")
    monkeypatch.setitem(sys.modules, "pylibfranka", module)
    return robot


def make_loop(system, goal, **arguments):
    limits = Limits.franka(system)
    return ControlLoop(
        system,
        make_controller("energy_shaping", system, goal),
        PERIOD,
        torque_filter=TorqueFilter(system, period=PERIOD, limits=limits),
        stale_after=0.1,
        deadline=1.0,
        **arguments,
    )


@pytest.mark.parametrize("start_time", [0.0, 0.3])
def test_a_law_moves_the_arm_to_its_goal_and_the_robot_is_never_given_cause_to_stop(franka, start_time):
    system = make_system("panda")
    goal = np.clip(system.robot.home + 0.2, system.robot.lower + 0.1, system.robot.upper - 0.1)
    loop = make_loop(system, goal, start_time=start_time)
    with FrankaArm("robot", system) as arm:
        np.testing.assert_allclose(arm.weight_error, 0.0, atol=1e-12)
        drive(loop, arm, 3.0)
        reading = arm.read()
    assert loop.mode == LoopMode.RUNNING, loop.reason
    np.testing.assert_allclose(reading.position, goal, atol=2e-3)
    assert Robot.last.finished
    assert arm.robot is None
    assert Robot.last.config == "ignore"


def test_states_that_are_lost_are_counted_by_the_robots_clock(franka):
    franka.lost = {100: 4, 200: 2}
    system = make_system("panda")
    loop = make_loop(system, system.robot.home)
    with FrankaArm("robot", system) as arm:
        drive(loop, arm, 0.3)
    assert arm.counts == {"readings": 300, "lost": 4}
    assert loop.timing.skipped == 4


def test_a_computer_that_is_slow_where_the_robot_waits_has_missed_nothing(franka):
    """The loop's clock goes 5 ms a reading, the robot's 1 ms: a simulated Franka stopped six times for that."""
    from tests.runtime.test_control_loop import Clock

    system = make_system("panda")
    clock = Clock()
    loop = make_loop(system, system.robot.home, clock=clock)
    with FrankaArm("robot", system) as arm:

        def slow(*_):
            clock.now += 5e-3

        drive(loop, arm, 0.3, each_step=slow)
    assert loop.timing.skipped == 0
    assert loop.timing.interval_p50 == pytest.approx(5e-3, rel=0.01)
    assert loop.counts["stops"] == 0


def test_a_reflex_is_an_error_that_says_what_to_do_and_lets_go_of_the_robot(franka):
    franka.reflex_at = 50
    system = make_system("panda")
    loop = make_loop(system, system.robot.home)
    with (
        pytest.raises(
            ArmError, match="robot at robot stopped: .*joint_velocity_violation.* TorqueFilter with Limits.franka"
        ),
        FrankaArm("robot", system) as arm,
    ):
        drive(loop, arm, 1.0)
    with pytest.raises(ArmError, match="not under control"):
        arm.read()
    with FrankaArm("robot", system) as arm:
        arm.read()
        with pytest.raises(ArmError, match="controller_torque_discontinuity.* the torque jumped"):
            arm.write(np.full(7, 5.0))


def test_an_error_of_the_program_stops_the_robot_too(franka):
    system = make_system("panda")

    def broken():
        with FrankaArm("robot", system) as arm:
            arm.read()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        broken()
    assert Robot.last.finished


def test_external_forces_are_those_on_the_robot_and_only_if_asked_for(franka):
    """libfranka: what the robot does to its environment is positive."""
    system = make_system("panda")
    with FrankaArm("robot", system) as arm:
        assert arm.read().measured.external_force is None
    with FrankaArm("robot", system, external_force=True) as arm:
        np.testing.assert_array_equal(arm.read().measured.external_force, [-1.0, -2.0, -3.0, -4.0, -5.0, -6.0, -7.0])


@pytest.mark.parametrize(
    ("mode", "errors", "message"),
    [
        ("Reflex", ["joint_reflex"], r"in mode Reflex, not Idle \(\['joint_reflex'\]\): .*recover=True"),
        ("UserStopped", [], "in mode UserStopped, not Idle: .*button"),
        ("Guiding", [], "in mode Guiding, not Idle"),
        ("Move", [], "in mode Move, not Idle: another program moves it"),
        ("Other", [], "in mode Other, not Idle: open the brakes"),
    ],
)
def test_a_robot_in_the_wrong_mode_is_not_moved(franka, mode, errors, message):
    franka.mode, franka.errors = mode, errors
    arm = FrankaArm("robot", make_system("panda"))
    with pytest.raises(ArmError, match=message):
        arm.__enter__()


def test_an_old_error_is_cleared_if_asked_for(franka):
    franka.mode, franka.errors = "Reflex", ["joint_reflex"]
    with FrankaArm("robot", make_system("panda"), recover=True) as arm:
        arm.read()
    assert franka.recovered


def test_no_robot_at_the_address_is_said_so(franka):
    franka.refuses = RuntimeError("libfranka: Connection timeout")
    with pytest.raises(ArmError, match="no robot answers at 172.16.0.9: libfranka: Connection timeout. Is FCI"):
        FrankaArm("172.16.0.9", make_system("panda")).__enter__()
    franka.refuses = RuntimeError("Running kernel does not have realtime capabilities.")
    with pytest.raises(ArmError, match="realtime capabilities.: see what `phcontrol preflight` says"):
        FrankaArm("172.16.0.9", make_system("panda"), realtime=True).__enter__()


def test_a_hand_that_holds_what_the_model_does_not_know_is_said(franka):
    franka.load = np.array([0.0, 8.0, 0.0, -6.0, 0.0, 2.0, 0.0])
    with pytest.warns(UserWarning, match=r"differ from the model's weight by \[8.0, -6.0, 2.0\] N·m at"):
        FrankaArm("robot", make_system("panda")).__enter__()


def test_what_sensors_and_model_may_differ_by_is_5_newton_metres_and_at_the_wrist_1_5(franka):
    at_most = np.array([5.0, 5.0, 5.0, 5.0, 1.5, 1.5, 1.5])
    signs = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    franka.load = 0.98 * signs * at_most
    arm = FrankaArm("robot", make_system("panda"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm.__enter__()
    np.testing.assert_allclose(arm.weight_error, franka.load, atol=1e-9)
    franka.load = 1.02 * signs * at_most
    names = ", ".join(f"'panda_joint{k}'" for k in range(1, 8))
    with pytest.warns(UserWarning, match=rf"N·m at \[{names}\]"):
        FrankaArm("robot", make_system("panda")).__enter__()


def test_collision_thresholds_are_set_together(franka):
    system = make_system("panda")
    with FrankaArm("robot", system, collision_torque=20.0, collision_force=[10, 10, 10, 5, 5, 5]):
        forces = [10.0, 10.0, 10.0, 5.0, 5.0, 5.0]
        assert Robot.last.collision == ([20.0] * 7, [20.0] * 7, forces, forces)
    with pytest.raises(InvalidArgumentError, match="must be given together"):
        FrankaArm("robot", system, collision_torque=20.0)


def test_another_arm_or_another_order_of_joints_is_refused(franka, tmp_path):
    with pytest.raises(InvalidArgumentError, match="must have the robot's 7 joints, but ur5 has 6"):
        FrankaArm("robot", make_system("ur5"))
    with pytest.raises(
        InvalidArgumentError, match=r"7 joints, but panda has 8: .*panda_finger_joint1; lock the fingers"
    ):
        FrankaArm("robot", make_system("panda_with_fingers"))
    with pytest.raises(InvalidArgumentError, match="joint1 to joint7, but number 1 of pera is 'shoulder"):
        FrankaArm("robot", make_system("pera"))
    text = load_robot("panda").description.replace("panda_joint3", "panda_jointx")
    text = text.replace("panda_joint4", "panda_joint3").replace("panda_jointx", "panda_joint4")
    path = tmp_path / "swapped.urdf"
    path.write_text(text)
    swapped = MechanicalSystem(load_robot(path, locked_joints=["panda_finger_joint1", "panda_finger_joint2"]))
    with pytest.raises(InvalidArgumentError, match="but number 3 of swapped is 'panda_joint4'"):
        FrankaArm("robot", swapped)


@pytest.mark.parametrize(
    ("version", "message"),
    [
        ((3, 13, 0), r"wheels for Python 3.10 to 3.12 only, and this is Python 3.13"),
        ((3, 11, 0), "pip install"),
        ((3, 12, 4), "pip install"),
        ((3, 9, 7), "this is Python 3.9"),
    ],
)
def test_without_its_client_it_is_said_what_is_missing(monkeypatch, version, message):
    monkeypatch.setitem(sys.modules, "pylibfranka", None)
    monkeypatch.setattr(franka_arm, "sys", SimpleNamespace(version_info=version))
    with pytest.raises(PHControlError, match=message):
        FrankaArm("robot", make_system("panda"))
