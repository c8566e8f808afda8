"""The wrist sensor: the tool's weight against Pinocchio's own, taring, and what postures can tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    ControlBox,
    InvalidArgumentError,
    MechanicalSystem,
    SensedArm,
    SimulatedArm,
    Tool,
    UnknownNameError,
    WristSensor,
)
from tests.conftest import make_system

FRAME = "panda_link8"
TOOL = Tool(0.8, np.array([0.02, -0.01, 0.06]))
OFFSET = np.array([3.0, -2.0, 5.0, 0.2, -0.3, 0.1])


def with_mass(system, tool):
    """The arm with a point mass in the sensor's frame: gravity by Pinocchio's algorithms alone."""
    robot = system.robot
    model = robot.model.copy()
    frame = model.frames[robot.frame_id(FRAME)]
    model.appendBodyToJoint(frame.parentJoint, pin.Inertia(tool.mass, tool.centre, np.zeros((3, 3))), frame.placement)
    return MechanicalSystem(replace(robot, model=model))


@pytest.fixture
def panda():
    return make_system("panda")


def test_the_weight_of_the_tool_is_what_it_adds_to_the_arms(panda, rng):
    heavier, sensor = with_mass(panda, TOOL), WristSensor(panda, FRAME, TOOL)
    for _ in range(20):
        q = panda.robot.random_position(rng)
        x = panda.at(q)
        added = x.gravity - heavier.at(q).gravity
        assert np.abs(added).max() > 0.5
        np.testing.assert_allclose(sensor.weight(x) @ x.frame_jacobian(FRAME, "local"), added, atol=1e-10)


def test_a_force_on_the_tool_is_measured_whatever_hangs_there(panda, rng):
    truth = WristSensor(panda, FRAME, TOOL, offset=OFFSET)
    sensor = WristSensor(panda, FRAME, TOOL)
    q = panda.robot.home
    sensor = sensor.tare(q, [OFFSET + truth.weight(panda.at(q)) + 0.01 * k for k in (-1, 0, 1)])
    np.testing.assert_allclose(sensor.offset, OFFSET, atol=1e-12)
    push = np.array([1.0, -4.0, 2.0, 0.1, 0.5, -0.2])
    for _ in range(10):
        x = panda.at(panda.robot.random_position(rng), rng.normal(size=7))
        reading = OFFSET + truth.weight(x) + push
        np.testing.assert_allclose(sensor.wrench(x, reading), push, atol=1e-12)
        np.testing.assert_allclose(
            sensor.external_force(x, reading), x.frame_jacobian(FRAME, "local").T @ push, atol=1e-12
        )
    without = WristSensor(panda, FRAME, offset=sensor.offset)
    assert np.abs(without.wrench(x, reading) - push).max() > 1.0


def test_postures_tell_the_tool_and_the_offset(panda, rng):
    truth = WristSensor(panda, FRAME, TOOL, offset=OFFSET)
    postures = [panda.robot.random_position(rng) for _ in range(8)]
    readings = [truth.weight(panda.at(q)) + OFFSET for q in postures]
    found = WristSensor(panda, FRAME).with_tool(postures, readings)
    assert found.tool.mass == pytest.approx(0.8, rel=1e-9)
    np.testing.assert_allclose(found.tool.centre, TOOL.centre, atol=1e-9)
    np.testing.assert_allclose(found.offset, OFFSET, atol=1e-9)
    noisy = np.array(readings) + 0.05 * rng.normal(size=(8, 6))
    assert WristSensor(panda, FRAME).with_tool(postures, noisy).tool.mass == pytest.approx(0.8, abs=0.02)
    with pytest.raises(InvalidArgumentError, match="do not tell the tool's weight from the sensor's offset"):
        WristSensor(panda, FRAME).with_tool([postures[0]] * 8, [readings[0]] * 8)
    turned = [panda.robot.position({"panda_joint1": angle}) for angle in np.linspace(-1, 1, 8)]  # the hand still down
    with pytest.raises(InvalidArgumentError, match="turn the hand to more directions"):
        WristSensor(panda, FRAME).with_tool(turned, [truth.weight(panda.at(q)) for q in turned])
    with pytest.raises(InvalidArgumentError, match="say that the tool weighs -0.8 kg: is their sign"):
        WristSensor(panda, FRAME).with_tool(postures, -np.array(readings))
    with pytest.raises(InvalidArgumentError, match="must be one for each of 8 postures, not 2"):
        WristSensor(panda, FRAME).with_tool(postures, readings[:2])


def test_two_hands_do_not_tell_and_three_do_upside_down_or_not(panda):
    """Of two directions c along their difference stays unknown: one singular value alone is 0."""
    truth = WristSensor(panda, FRAME, TOOL, offset=OFFSET)
    home = panda.robot.position({"panda_joint2": -1.0, "panda_joint4": -2.0, "panda_joint6": 2.5})
    postures = [home, home.copy(), home.copy()]
    postures[1][3] += 0.6
    postures[2][6] += 0.9

    def found(chosen):
        return WristSensor(panda, FRAME).with_tool(chosen, [truth.weight(panda.at(q)) + OFFSET for q in chosen])

    np.testing.assert_allclose(found(postures).offset, OFFSET, atol=1e-9)
    for pair in ((0, 1), (0, 2), (1, 2)):
        with pytest.raises(InvalidArgumentError, match="turn the hand to more directions"):
            found([postures[k] for k in pair] * 2)
    level = panda.robot.position({"panda_joint2": 0.0, "panda_joint4": -0.5 * np.pi})
    downs = [level + angle * np.eye(7)[5] for angle in (0.0, np.pi, 1.0)]
    turns = [panda.at(q).placement(FRAME).rotation[2] for q in downs]
    np.testing.assert_allclose(turns[0], -turns[1], atol=1e-9)
    np.testing.assert_allclose(found(downs).offset, OFFSET, atol=1e-9)


@pytest.mark.parametrize(("turned", "enough"), [(2e-6, False), (1e-3, True)])
def test_hands_turned_by_rounding_alone_do_not_tell(panda, turned, enough):
    truth = WristSensor(panda, FRAME, TOOL, offset=OFFSET)
    home = panda.robot.position({"panda_joint2": -1.0, "panda_joint4": -2.0, "panda_joint6": 2.5})
    postures = home + turned * np.eye(7)[[0, 3, 6]]
    readings = [truth.weight(panda.at(q)) + OFFSET for q in postures]
    if enough:
        np.testing.assert_allclose(WristSensor(panda, FRAME).with_tool(postures, readings).offset, OFFSET, atol=1e-6)
        return
    with pytest.raises(InvalidArgumentError, match="turn the hand to more directions"):
        WristSensor(panda, FRAME).with_tool(postures, readings)


def test_an_arm_with_a_sensor_measures_by_it(panda):
    sensor = WristSensor(panda, FRAME, TOOL, offset=OFFSET)
    box = ControlBox(panda)
    x = panda.at(panda.robot.home)
    push = np.array([0.0, 0.0, -5.0, 0.0, 0.0, 0.0])
    wrenches = [OFFSET + sensor.weight(x) + push, None]
    arm = SensedArm(SimulatedArm(box), sensor, lambda: wrenches.pop(0))
    assert (arm.gravity, arm.pace) == ("controller", "write")
    np.testing.assert_allclose(
        arm.read().measured.external_force, x.frame_jacobian(FRAME, "local").T @ push, atol=1e-12
    )
    assert arm.read().measured.external_force is None
    arm.write(np.zeros(7))
    assert box.time > 0.0


def test_bad_sensors_are_refused(panda):
    with pytest.raises(UnknownNameError, match="frame"):
        WristSensor(panda, "hand")
    with pytest.raises(InvalidArgumentError, match="tool.mass"):
        WristSensor(panda, FRAME, Tool(-1.0, np.zeros(3)))
    with pytest.raises(InvalidArgumentError, match="offset"):
        WristSensor(panda, FRAME, offset=[0.0, 1.0])
    with pytest.raises(InvalidArgumentError, match="reading"):
        WristSensor(panda, FRAME).wrench(panda.at(panda.robot.home), np.full(6, np.nan))
    with pytest.raises(InvalidArgumentError, match=r"readings: must have shape \(6,\)"):
        WristSensor(panda, FRAME).tare(panda.robot.home, np.zeros((3, 5)))
    with pytest.raises(InvalidArgumentError, match="read: must be a function"):
        SensedArm(SimulatedArm(ControlBox(panda)), WristSensor(panda, FRAME), None)
