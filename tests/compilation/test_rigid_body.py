"""Rigid-body quantities for any scalar, against Pinocchio's."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import load_robot
from phcontrol.compilation.rigid_body import ArmModel, _turned
from phcontrol.mechanics import derivatives
from phcontrol.mechanics.robot import REFERENCES

ARMS = {
    "pera": {},
    "panda": {},  # prismatic fingers on two branches
    "kinova": {},  # continuous joints
    "ur5": {"armature": 0.1},
    "pera_with_gripper": {},
}


@pytest.fixture(params=list(ARMS))
def robot(request):
    return load_robot(request.param, **ARMS[request.param])


def near(found, expected):
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(np.array(found, dtype=float), expected, rtol=0.0, atol=2e-14 * scale)


def test_a_turn_about_an_oblique_axis():
    axis = np.array([2.0, -3.0, 6.0]) / 7.0
    np.testing.assert_allclose(np.array(_turned(tuple(axis), 0.7)), pin.exp3(0.7 * axis), atol=1e-15)


def test_forces_and_inertias(robot, rng):
    model = robot.model.copy()
    model.gravity.linear = np.array([1.0, 2.0, -9.81])
    model.inertias[model.njoints - 1] += pin.Inertia(0.7, np.array([0.1, -0.2, 0.05]), 1e-3 * np.eye(3))  # a payload
    data, arm = model.createData(), ArmModel(model)
    for _ in range(3):
        q, v, s, a = rng.normal(size=(4, model.nv))
        posture = arm.at(q)
        M = pin.crba(model, data, q).copy()
        C = pin.computeCoriolisMatrix(model, data, q, v).copy()
        g = pin.computeGeneralizedGravity(model, data, q).copy()
        near(posture.mass_matrix(), M)
        near(posture.coriolis_matrix(v), C)
        near(posture.gravity(), g)
        near(posture.inverse_dynamics(v, s, a), M @ a + C @ s + g)
        near(posture.mass_matrix_derivative(), derivatives.mass_matrix_derivative(model, data, q))
        near(posture.weight_energy(), pin.computePotentialEnergy(model, data, q))


@pytest.mark.parametrize("reference", list(REFERENCES))
def test_frames(robot, reference, rng):
    model, data, arm = robot.model, robot.model.createData(), ArmModel(robot.model)
    q, v = rng.normal(size=(2, model.nv))
    posture, kind = arm.at(q), REFERENCES[reference]
    for frame in (robot.frame_id(name) for name in robot.frame_names[:: max(1, len(robot.frame_names) // 6)]):
        translation, rotation = posture.frame(frame)
        pin.framesForwardKinematics(model, data, q)
        near(translation, data.oMf[frame].translation)
        near(rotation, data.oMf[frame].rotation)
        near(posture.frame_jacobian(frame, reference), pin.computeFrameJacobian(model, data, q, frame, kind))
        rate = derivatives.frame_jacobian_rate(model, data, q, v, frame, kind)
        near(posture.frame_jacobian_rate(frame, v, reference), rate)


def test_a_link_that_is_heavier_than_described_is_seen(robot, rng):
    """The comparison can fail: one kilogram on one link is enough."""
    model = robot.model.copy()
    arm = ArmModel(model)
    model.inertias[1] = model.inertias[1] + pin.Inertia(1.0, np.array([0.1, 0.0, 0.2]), np.zeros((3, 3)))
    q = rng.normal(size=model.nv)
    with pytest.raises(AssertionError):
        near(arm.at(q).mass_matrix(), pin.crba(model, model.createData(), q))
