"""A run to show."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import MechanicalSystem, RigidBody, SphereContact, Wrench, load_robot, make_controller, simulate

GOAL = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]


@pytest.fixture(scope="session")
def log():
    """The PERA is pulled at its hand, down onto a table below its tool, and sideways."""
    system = MechanicalSystem(load_robot("pera"))
    tip = system.robot.placement("tool", GOAL).translation
    table = SphereContact("tool", 0.01, "plane", position=tip - [0.0, 0.0, 0.03])
    return simulate(
        system,
        make_controller("force_feedback", system, goal=GOAL),
        duration=2.0,
        dt=4e-3,
        q0=np.array(GOAL) - [0.2, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
        bodies=[RigidBody(table, stiffness=1e3, damping=20.0)],
        disturbance=Wrench("hand", lambda t: [5.0 * np.sin(t), 0.0, -25.0, 0.0, 0.0, 0.0]),
    )
