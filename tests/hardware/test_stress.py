"""Large steps under stiff gains on the Research 3 of franky-sim in lock step, judged by what stops a real one.

Effort, rate of the torque, velocities near the stops by libfranka's formula, and the hand's speed. In lock step, so
that a slow computer does not count; the plant has dry friction of 1.1 N·m, rotors and a hand of its own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from phcontrol import ControlLoop, Limits, MechanicalSystem, MujocoArm, TorqueFilter, load_robot, make_controller

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'phcontrol[mujoco]'")
franky_sim = pytest.importorskip("franky_sim", reason="needs franky-sim, which brings a model of the robot")

ASSETS = Path(franky_sim.__file__).parent / "assets"
PERIOD, START = 1e-3, np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785])


@pytest.fixture(scope="module")
def system():
    fingers = ("fr3_finger_joint1", "fr3_finger_joint2")
    return MechanicalSystem(load_robot(ASSETS / "fr3.urdf", locked_joints=fingers, armature=0.195), friction=None)


def reason_to_stop(system, seed, stiffness, start_time, margin):
    """Return why a robot would have stopped; empty if it would not."""
    text = (ASSETS / "fr3.xml").read_text().replace('meshdir="assets"', f'meshdir="{ASSETS / "meshes"}"')
    arm = MujocoArm(system, mujoco.MjModel.from_xml_string(text), gravity="robot", position=START)
    limits = None if margin is None else Limits.franka(system, velocity_margin=margin)
    inside = Limits.franka(system)
    goal = np.clip(
        START + 0.6 * np.random.default_rng(seed).choice([-1, 1], 7), inside.lower + 0.05, inside.upper - 0.05
    )
    inertia = system.at(START).mass_matrix.diagonal()
    loop = ControlLoop(
        system,
        make_controller("energy_shaping", system, goal, stiffness=stiffness * inertia),
        PERIOD,
        torque_filter=None if limits is None else TorqueFilter(system, period=PERIOD, limits=limits),
        start_time=start_time,
        gravity=arm.gravity,
        clock=lambda: arm.time,
    )
    robot, last = system.robot, np.zeros(7)
    offset, deceleration = robot.stop_velocity.offset, robot.stop_velocity.deceleration
    for _ in range(round((0.7 + start_time) / PERIOD)):
        reading = arm.read()
        torque = loop.step(reading.position, reading.velocity, torque=reading.torque)
        if (np.abs(torque) > robot.effort_limit).any():
            return "tau_j_range_violation"
        if np.abs(torque - last).max() > 1000.0 * PERIOD:
            return "controller_torque_discontinuity"
        last = torque
        arm.write(torque)
        q, v = arm.read()[:2]
        up, down = (
            np.maximum(0.0, -offset + np.sqrt(np.maximum(0.0, 2.0 * deceleration * way)))
            for way in (robot.upper - q, q - robot.lower)
        )
        if (v > np.minimum(robot.velocity_limit, up)).any() or (-v > np.minimum(robot.velocity_limit, down)).any():
            return "joint_velocity_violation"
        hand = system.at(q, v).frame_jacobian("fr3_hand_tcp", "local_world_aligned")[:3] @ v
        if np.linalg.norm(hand) > 3.0:
            return "cartesian_velocity_violation"
    return ""


@pytest.mark.parametrize("start_time", [0.0, 0.5])
@pytest.mark.parametrize("stiffness", [400.0, 2500.0])
def test_with_the_filter_nothing_stops_the_robot_and_without_it_something_does(system, stiffness, start_time):
    assert reason_to_stop(system, 1, stiffness, start_time, None) != ""
    for seed in (0, 1):
        assert reason_to_stop(system, seed, stiffness, start_time, 0.35) == ""
