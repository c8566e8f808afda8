"""Bounds on inertia and weight that hold in every posture, on arms of all kinds."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import MechanicalSystem, load_robot
from phcontrol.mechanics.least_inertia import least_inertia
from phcontrol.mechanics.weight_slopes import weight_slopes
from tests.controllers.arms import chain
from tests.finite_differences import gradient

ARMS = ["panda", "ur5", "pera", "pera_with_gripper", "z1", "xarm7", "kinova", "chain of 5"]


def arm(name):
    return chain(5) if name.startswith("chain") else MechanicalSystem(load_robot(name))


def drawn(system, count=400):
    generator = np.random.default_rng(3)
    return [system.robot.random_position(generator) for _ in range(count)]


@pytest.mark.parametrize("name", ARMS)
def test_no_posture_has_a_joint_that_is_easier_to_move(name):
    system = arm(name)
    bound = least_inertia(system)
    assert (bound > 0.0).all()
    seen = np.min([1.0 / np.linalg.inv(system.at(q).mass_matrix).diagonal() for q in drawn(system)], axis=0)
    assert (bound <= seen * (1.0 + 1e-9)).all()
    assert (seen / bound).min() < 3.0  # a bound of a thousandth would hold too


def test_two_joints_are_bounded_as_well_as_can_be():
    """There the two bodies are the whole arm: the least over a fine grid of the second joint is attained to 1 %."""
    system = MechanicalSystem(load_robot("pera_shoulder"))
    grid = np.linspace(-np.pi, np.pi, 721)
    seen = np.min([1.0 / np.linalg.inv(system.at([0.0, q]).mass_matrix).diagonal() for q in grid], axis=0)
    bound = least_inertia(system)
    assert (bound <= seen).all()
    np.testing.assert_allclose(bound, seen, rtol=0.02)


def test_a_rotor_counts_in_full():
    bare = MechanicalSystem(load_robot("ur5"))
    geared = MechanicalSystem(load_robot("ur5", armature=0.4))
    np.testing.assert_allclose(least_inertia(geared)[1:] - least_inertia(bare)[1:], 0.4)
    assert least_inertia(geared)[0] >= least_inertia(bare)[0] + 0.4


@pytest.mark.parametrize("name", ARMS)
def test_no_posture_has_a_weight_that_changes_faster(name):
    system = arm(name)
    bound = weight_slopes(system)
    np.testing.assert_allclose(bound, bound.T)
    worst = np.max([np.abs(gradient(lambda p: system.at(p).gravity, q)) for q in drawn(system, 40)], axis=0)
    assert (worst <= bound + 1e-6 * max(1.0, bound.max())).all()
    assert worst.max() > 0.5 * bound.max()
