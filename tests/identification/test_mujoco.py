"""MuJoCo as the plant: what its FR3 carries and how it rubs is found, and a law that knows it follows closer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from phcontrol import Limits, MechanicalSystem, TrajectoryTracking, exciting_trajectory, identify
from tests.identification import mujoco_plant

pytest.importorskip("mujoco")
pytestmark = pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")

MASS, COM, INERTIA = 0.76, (0.02, -0.01, 0.05), (0.004, 0.003, 0.002)
GAINS = {"stiffness": [2000, 2000, 1500, 1500, 600, 500, 300], "damping": [60, 60, 50, 50, 20, 15, 10]}


@cache
def setting():
    """The FR3 of a description without rotors, friction and payload; MuJoCo's with them; a motion."""
    bare = replace(mujoco_plant.arm(armature=0.0), friction=None)
    limits = Limits(MechanicalSystem(bare), velocity=[2.0] * 4 + [2.5] * 3)
    start = mujoco_plant.READY
    motion = exciting_trajectory(bare, limits, 20.0, frame="tcp", start=start, candidates=60)
    return bare, mujoco_plant.plant(MASS, COM, INERTIA), motion


@cache
def measured(noise):
    bare, plant, motion = setting()
    law = TrajectoryTracking.tuned(MechanicalSystem(bare), trajectory=motion, **GAINS)
    return mujoco_plant.run(plant, law, 20.0, mujoco_plant.READY, noise=noise)


@cache
def identified(noise):
    return identify(measured(noise)[0], ("payload", "coulomb", "viscous", "armature"), model=setting()[0], frame="tcp")


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_payload_friction_and_rotors_of_mujoco_are_found(noise):
    """Noise of 1 mrad/s in velocity, 0.1 mrad in position and 10 mN·m in torque."""
    found, true = identified(noise), mujoco_plant.arm()
    assert found.passed
    assert found.payload.mass == pytest.approx(MASS, rel=1e-2)
    np.testing.assert_allclose(found.payload.com, COM, atol=1e-3)
    np.testing.assert_allclose(found.robot.friction.coulomb, true.friction.coulomb, rtol=5e-2)
    np.testing.assert_allclose(found.robot.friction.viscous, true.friction.viscous, rtol=5e-2)
    np.testing.assert_allclose(found.robot.model.armature, true.model.armature, rtol=1e-1)


def test_a_law_that_knows_it_follows_closer():
    _, plant, motion = setting()
    law = TrajectoryTracking.tuned(MechanicalSystem(identified(1e-3).robot), trajectory=motion, **GAINS)
    error = {}
    for name, run in (("plain", measured(0.0)[1]),
                      ("identified", mujoco_plant.run(plant, law, 10.0, mujoco_plant.READY)[1])):  # fmt: skip
        rows = run.time < 10.0
        desired = np.array([motion.at(t).position for t in run.time[rows]])
        error[name] = np.sqrt(np.mean((run.position[rows] - desired) ** 2))
    assert error["plain"] > 5.0 * error["identified"]
