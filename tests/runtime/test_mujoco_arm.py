"""MuJoCo as a plant: the same motion without friction, contacts and forces of its own, and what is refused."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from phcontrol import (
    ControlLoop,
    InvalidArgumentError,
    LoopMode,
    MechanicalSystem,
    MujocoArm,
    PHControlError,
    RobotDescriptionError,
    drive,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.runtime.mujoco_arm import _of_mujoco
from tests.conftest import ARMS, make_system

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'phcontrol[mujoco]'")

PERIOD = 1e-3

URDF = """<robot name="pair">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.15 0 0.02"/><mass value="1.5"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.2 0.01 0"/><mass value="0.8"/>
  <inertia ixx="0.004" iyy="0.01" izz="0.009" ixy="0" ixz="0" iyz="0.0005"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.5"/>
  <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="40" velocity="5"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="5"/></joint>
</robot>"""

# the same arm with its elbow first, a motor of its own on it, a wheel that is not ours, and a floor to lie on
MJCF = """<mujoco><option timestep="0.0005" integrator="implicitfast"/>
<worldbody>
  <geom name="floor" type="plane" size="2 2 0.1"/>
  <body name="wheel" pos="-1 0 1"><joint name="wheel" axis="0 1 0"/><geom type="sphere" size="0.1" mass="1"/></body>
  <body name="upper" pos="0 0 0.5">
    <inertial pos="0.15 0 0.02" mass="1.5" fullinertia="0.01 0.02 0.02 0.001 0 0"/>
    <joint name="shoulder" axis="0 1 0" {damping}/>
    <body name="fore" pos="0.3 0 0">
      <inertial pos="0.2 0.01 0" mass="0.8" fullinertia="0.004 0.01 0.009 0 0 0.0005"/>
      <joint name="elbow" axis="0 1 0"/>
      <geom name="tip" type="sphere" size="0.02" pos="0.4 0 0"/>
    </body>
  </body>
</worldbody>
<actuator><position joint="elbow" kp="1000"/></actuator></mujoco>"""


@pytest.fixture
def pair(tmp_path):
    (tmp_path / "pair.urdf").write_text(URDF)
    return MechanicalSystem(load_robot(tmp_path / "pair.urdf"))


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.xml").write_text(MJCF.format(damping=""))
    return tmp_path / "scene.xml"


def run(system, arm, goal, seconds):
    loop = ControlLoop(
        system, make_controller("energy_shaping", system, goal), PERIOD, start_time=0.0, clock=lambda: arm.time
    )
    positions = []
    drive(loop, arm, seconds, each_step=lambda t, reading, torque: positions.append(reading.position))
    assert loop.mode == LoopMode.RUNNING, loop.reason
    return np.array(positions)


@pytest.mark.parametrize("name", ["pera", "panda", "ur5", "kinova"])
def test_without_friction_the_simulation_and_mujoco_agree(name):
    """Two seconds, RK4 with steps of 1 ms on both sides: M, C, g and the kinematics are computed by two libraries.

    MuJoCo's Euler on the same model is the check that the bound of 1e-9 rad sees anything at all.
    """
    system = MechanicalSystem(load_robot(name, **ARMS[name]), friction=None)
    start = system.robot.near_home()
    goal = np.clip(start + 0.3, system.robot.lower + 0.1, system.robot.upper - 0.1)
    log = simulate(
        system,
        make_controller("energy_shaping", system, goal),
        duration=2.0,
        dt=PERIOD,
        q0=start,
        control_period=PERIOD,
        torque_limit="robot",
    )
    positions = run(system, MujocoArm(system, position=start), goal, 2.0)
    assert np.abs(positions - start).max() > 0.2
    np.testing.assert_allclose(positions, log.position[:-1], atol=1e-9)
    other = run(system, MujocoArm(system, position=start, integrator="Euler"), goal, 2.0)
    assert np.abs(other - log.position[:-1]).max() > 1e-5


def test_locked_joints_rotors_and_viscous_friction_are_in_the_plant():
    """A Panda with a bent wrist locked, rotors, and viscous friction, against the simulation of that plant."""
    robot = load_robot(
        "panda",
        locked_joints={
            "panda_finger_joint1": 0.02, "panda_finger_joint2": 0.03, "panda_joint5": 0.7, "panda_joint2": -0.4
        },
        armature=0.2,
    )  # fmt: skip
    from phcontrol import StribeckFriction

    friction = StribeckFriction(viscous=[2.0, 1.0, 0.5, 0.3, 0.2], coulomb=0.0, static=0.0)
    system = MechanicalSystem(robot, friction=friction)
    start = robot.near_home()
    goal = np.clip(start + 0.3, robot.lower + 0.1, robot.upper - 0.1)
    law = make_controller("energy_shaping", system, goal)
    log = simulate(system, law, duration=1.0, dt=PERIOD, q0=start, control_period=PERIOD, torque_limit="robot")
    np.testing.assert_allclose(run(system, MujocoArm(system, position=start), goal, 1.0), log.position[:-1], atol=1e-9)
    without = run(system, MujocoArm(system, position=start, friction=False), goal, 1.0)
    assert np.abs(without - log.position[:-1]).max() > 1e-3


def test_an_mjcf_is_put_together_with_the_robot_by_its_joints_names(pair, scene):
    """Not by their order: a wheel comes first. Its motor on our elbow is silent, and the wheel turns as it likes."""
    arm = MujocoArm(pair, scene, period=PERIOD, position=[-0.5, 0.3])
    np.testing.assert_array_equal(arm.read().position, [-0.5, 0.3])
    for _ in range(200):
        arm.write(pair.at(arm.read().position).gravity)
    np.testing.assert_allclose(arm.read().position, [-0.5, 0.3], atol=1e-5)
    assert arm.time == pytest.approx(0.2)
    assert arm.data.time == pytest.approx(0.2)  # in steps of 0.5 ms


def test_an_arm_that_adds_its_weight_stands_still_without_a_torque(pair, scene):
    arm = MujocoArm(pair, scene, gravity="robot", position=[-0.5, 0.3])
    for _ in range(200):
        arm.write(np.zeros(2))
    np.testing.assert_allclose(arm.read().position, [-0.5, 0.3], atol=1e-12)
    loop = ControlLoop(
        pair, make_controller("energy_shaping", pair, [-0.8, 0.6]), PERIOD, start_time=0.0, clock=lambda: arm.time
    )
    drive(loop, arm, 4.0)
    np.testing.assert_allclose(arm.read().position, [-0.8, 0.6], atol=1e-3)


def test_the_torque_is_clipped_to_the_effort_of_the_motors(pair, scene):
    arm = MujocoArm(pair, scene, gravity="robot", position=[-0.5, 0.3])
    arm.write(np.array([1e3, -1e3]))
    np.testing.assert_array_equal(arm.data.qfrc_applied[arm._freedoms], [40.0, -20.0])


def test_the_external_force_is_that_of_a_push_at_a_body(pair, scene):
    """𝒥ᵀF with Pinocchio's Jacobian of the body's centre of mass."""
    arm = MujocoArm(pair, scene, position=[-0.5, 0.3])
    body = arm.model.body("fore").id
    force, torque = np.array([3.0, -2.0, 5.0]), np.array([0.3, 0.5, -0.2])
    arm.data.xfrc_applied[body] = [*force, *torque]
    robot = pair.robot.with_frame("centre", "fore", _placement([0.2, 0.01, 0.0]))
    jacobian = MechanicalSystem(robot).at([-0.5, 0.3]).frame_jacobian("centre", "local_world_aligned")
    np.testing.assert_allclose(
        arm.read().measured.external_force, jacobian.T @ np.concatenate([force, torque]), rtol=1e-12
    )


def test_lying_on_the_floor_the_contact_carries_what_the_motors_do_not(pair, scene):
    """At rest u + f_e = g; the robot's friction and limits are not part of f_e."""
    arm = MujocoArm(pair, scene, position=[0.4, 0.6])
    for _ in range(4000):
        reading = arm.read()
        weight = pair.at(reading.position).gravity
        torque = weight + 60.0 * (np.array([0.6, 0.8]) - reading.position) - 12.0 * reading.velocity  # below the floor
        arm.write(torque)
    assert arm.data.ncon == 1
    reading = arm.read()
    assert np.abs(reading.velocity).max() < 1e-3
    missing = pair.at(reading.position).gravity - torque
    assert np.abs(missing).max() > 1.0
    np.testing.assert_allclose(reading.measured.external_force, missing, atol=1e-2)


def test_what_does_not_fit_together_is_refused(pair, scene, tmp_path):
    with pytest.raises(
        InvalidArgumentError, match=r"has no joint 'panda_joint1' of panda, whose 7 joints .* it has wheel"
    ):
        MujocoArm(make_system("panda"), scene)
    slide = tmp_path / "slide.xml"
    slide.write_text(MJCF.format(damping='type="slide"'))
    with pytest.raises(InvalidArgumentError, match="joint 'shoulder' slides in MuJoCo's model, and turns in pair"):
        MujocoArm(pair, slide)
    with pytest.raises(RobotDescriptionError, match="there is no such MJCF file"):
        MujocoArm(pair, tmp_path / "none.xml")
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody><body/></mujoco>")
    with pytest.raises(RobotDescriptionError, match="MuJoCo cannot read it"):
        MujocoArm(pair, broken)
    with pytest.raises(InvalidArgumentError, match="period"):
        MujocoArm(pair, scene, period=7e-4)
    with pytest.raises(InvalidArgumentError, match="mimic joints"):
        MujocoArm(make_system("panda_with_fingers"))
    with pytest.raises(InvalidArgumentError, match="springs"):
        MujocoArm(MechanicalSystem(pair.robot, potentials=make_system("pera_gripper").robot.potentials))
    with pytest.raises(PHControlError, match="not 2 finite numbers"):
        MujocoArm(pair, scene).write(np.array([np.nan, 0.0]))
    with pytest.raises(InvalidArgumentError, match="position"):
        MujocoArm(pair, scene, position=[0.0])


def _placement(xyz):
    placement = np.eye(4)
    placement[:3, 3] = xyz
    return placement


def test_the_mujoco_example_runs(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["mujoco_arm.py", "--seconds", "1.0"])
    runpy.run_path(str(Path(__file__).parents[2] / "examples" / "mujoco_arm.py"), run_name="__main__")
    printed = capsys.readouterr().out
    assert "RUNNING" in printed
    assert "rad from the simulation" in printed


def test_a_model_is_a_path_or_mujocos_own_of_which_a_copy_is_taken():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    taken = _of_mujoco(model)
    taken.opt.timestep = 0.5
    assert model.opt.timestep != 0.5
    with pytest.raises(InvalidArgumentError, match="model: must be the path of an MJCF file, .* but is list"):
        _of_mujoco([model])
