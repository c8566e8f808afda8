"""Arms and random states that the tests share."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from phcontrol import MechanicalSystem, load_robot
from tests.accessibility import axe
from tests.browser import browser
from tests.costs import pytest_addoption, pytest_collection_modifyitems, pytest_runtest_protocol

__all__ = ["axe", "browser", "pytest_addoption", "pytest_collection_modifyitems", "pytest_runtest_protocol"]

settings.register_profile(
    "default", deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
settings.load_profile("default")

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
ARMS = {
    "pera": {},
    "pera_shoulder_elbow": {},
    "pera_shoulder": {},
    "pera_gripper": {},
    "panda": {"locked_joints": FINGERS},
    "panda_with_fingers": {},  # the second finger mimics the first
    "ur5": {},
    "kinova": {},  # continuous joints
}
SHIPPED = ("pera", "pera_shoulder_elbow", "pera_shoulder", "pera_gripper", "pera_with_gripper")


@cache
def make_system(name: str) -> MechanicalSystem:
    return MechanicalSystem(load_robot(name.removesuffix("_with_fingers"), **ARMS.get(name, {})))


@pytest.fixture(params=list(ARMS))
def system(request: pytest.FixtureRequest) -> MechanicalSystem:
    return make_system(request.param)


@pytest.fixture
def pera() -> MechanicalSystem:
    return make_system("pera")


@pytest.fixture
def shoulder() -> MechanicalSystem:
    return make_system("pera_shoulder")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20151120)
