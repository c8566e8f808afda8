"""A frame's pose, twist, wrench and singularity in a log, against loops over the samples."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import Log, UnknownNameError, Wrench, make_controller, simulate
from tests.controllers.arms import arm


@pytest.fixture(scope="module")
def run():
    system = arm("panda")
    law = make_controller("cartesian_impedance", system)
    push = Wrench(system.hand_frame, [1.0, -2.0, 3.0, 0.1, 0.2, -0.3])
    return system, simulate(system, law, q0=system.robot.home + 0.1, duration=0.05, disturbance=push)


def test_pose_twist_and_wrench(run):
    system, log = run
    motion, model, data = log.frame(system.hand_frame), system.model, system.model.createData()
    index = model.getFrameId(system.hand_frame)
    for k in (0, 20, 50):
        pin.forwardKinematics(model, data, log.position[k], log.velocity[k])
        pin.updateFramePlacements(model, data)
        np.testing.assert_allclose(motion.position[k], data.oMf[index].translation, atol=1e-14)
        np.testing.assert_allclose(motion.rotation[k], data.oMf[index].rotation, atol=1e-14)
        twist = pin.getFrameVelocity(model, data, index, pin.LOCAL_WORLD_ALIGNED).vector
        np.testing.assert_allclose(motion.twist[k], twist, atol=1e-13)
        np.testing.assert_allclose(motion.wrench[k], [1.0, -2.0, 3.0, 0.1, 0.2, -0.3], atol=1e-10)
        J = pin.computeFrameJacobian(model, data, log.position[k], index, pin.LOCAL_WORLD_ALIGNED)
        assert motion.manipulability[k] == pytest.approx(np.prod(np.linalg.svd(J)[1]))
        scaled = np.linalg.svd(np.diag([1, 1, 1, 0.3, 0.3, 0.3]) @ J)[1][-1]
        assert motion.singularity_distance[k] == pytest.approx(scaled)
        M, v = system.at(log.position[k]).mass_matrix, log.velocity[k]
        inertia = np.linalg.inv(J @ np.linalg.solve(M, J.T))
        expected = 0.5 * v @ M @ v - 0.5 * (J @ v) @ inertia @ (J @ v)
        assert motion.self_motion_energy[k] == pytest.approx(expected, abs=1e-12)


def test_of_a_file_it_is_the_same(run, tmp_path):
    system, log = run
    again = Log.load(log.save(tmp_path / "log.npz"))
    frame = system.hand_frame
    np.testing.assert_allclose(again.frame(frame).twist, log.frame(frame).twist, atol=1e-13)
    with pytest.raises(UnknownNameError, match="hnad"):
        log.frame("hnad")
