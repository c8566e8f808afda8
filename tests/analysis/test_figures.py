"""The small pieces that every line of a certificate is made of."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phcontrol import EnergyShaping, ForceFeedback, MechanicalSystem, load_robot
from phcontrol.analysis.certificate import Check
from phcontrol.analysis.matching import indefiniteness
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen, largest_difference
from phcontrol.analysis.worst import Worst
from tests.conftest import make_system


def test_the_worst_is_the_first_of_the_largest():
    assert Worst.of([(1.0, "a"), (3.0, "b"), (3.0, "c"), (2.0, "d")]) == (3.0, "b")
    assert Worst.of([(0.0, "a"), (-1.0, "b")]) == (0.0, "")
    assert Worst.of([(-2.0, "a"), (-1.0, "b")], -math.inf) == (-1.0, "b")


def test_nan_is_the_worst_of_all_and_stays_it():
    assert Worst.of([(1.0, "a"), (math.nan, "b"), (2.0, "c")]) == (math.inf, "b")


def test_differences_are_relative_to_each_array():
    large, small = np.array([1000.0, -2000.0]), np.array([0.0, 1e-3])
    assert largest_difference([large, small], [large, small]) == 0.0
    assert largest_difference([large, small], [large + 2.0, small]) == pytest.approx(1e-3)
    assert largest_difference([large, small], [large, small + 1e-4]) == pytest.approx(0.1)
    assert largest_difference([np.zeros(2)], [np.array([0.0, 0.25])]) == 0.25  # of nothing: as it is
    assert largest_difference([np.zeros(0)], [np.zeros(0)]) == 0.0
    assert largest_difference([large], [large[:1]]) == math.inf
    assert largest_difference([large], [np.array([1000.0, math.nan])]) == math.inf
    assert largest_difference([large, small], [large, np.array([0.0, math.nan])]) == math.inf


@pytest.mark.parametrize(
    ("made", "passed", "relation"),
    [
        (Check.at_most("x", 1.0, 1.0), True, "<="),
        (Check.at_most("x", 2.0, 1.0), False, ">"),
        (Check.at_most("x", math.nan, 1.0), False, ">"),
        (Check.more_than("x", 2.0, 1.0), True, ">"),
        (Check.more_than("x", 1.0, 1.0), False, "<="),
        (Check.more_than("x", math.nan, 1.0), False, "<="),
    ],
)
def test_checks_say_how_their_figure_stands_to_the_bound(made, passed, relation):
    assert made.passed is passed
    assert made.relation == relation or math.isnan(made.value)
    assert ("FAILED" in str(made)) is not passed


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        (np.diag([1.0, 0.0, 1e7]), 0.0),
        (np.diag([1e7, -1e-3]), 1.0),
        (np.array([[1.0, 2.0], [2.0, 4.0]]), 0.0),  # of rank one
        (np.array([[1.0, 2.0], [2.0, 3.0]]), 2.0 / np.sqrt(3.0) - 1.0),
        (np.array([[0.0, 1.0], [1.0, 1.0]]), 1.0),
        (np.array([[1.0, 0.5], [0.0, 1.0]]), 0.5),
    ],
)
def test_indefiniteness_is_the_most_negative_eigenvalue_of_the_scaled_matrix(matrix, expected):
    assert indefiniteness(matrix) >= expected * (1.0 - 1e-12)
    assert indefiniteness(matrix) == pytest.approx(expected, abs=1e-15) or expected == 1.0


def test_an_absurd_velocity_limit_is_none():
    """Baxter's description gives its head 10⁴ rad/s: no natural unit, and no speed to look at a law at."""
    plant = MechanicalSystem(load_robot("baxter"))
    assert plant.robot.velocity_limit.max() == 1e4
    speed = NaturalUnits.of(EnergyShaping.tuned(plant), plant, 0.0).speed
    sane = plant.robot.velocity_limit < 100.0
    np.testing.assert_array_equal(speed[sane], plant.robot.velocity_limit[sane])
    np.testing.assert_allclose(speed[~sane], 2.0 * np.pi)


def test_a_law_is_shown_what_it_needs_and_the_same_elsewhere():
    plant = make_system("pera_shoulder")
    at = SampledState(1.0, np.array([0.1, 0.2]), np.array([0.3, 0.4]), np.zeros(2), np.array([5.0, 6.0]), None, "here")
    measuring = Seen.of(ForceFeedback.tuned(plant, measured=True), plant, at)
    np.testing.assert_array_equal(measuring.measured.external_force, at.force)
    assert measuring.measured.total_force is None
    moved = measuring.elsewhere(position=np.array([1.0, 1.0]), force=np.zeros(2))
    assert moved.measured is measuring.measured
    np.testing.assert_array_equal(moved.view.position, [1.0, 1.0])
    np.testing.assert_array_equal(moved.view.velocity, at.velocity)
    assert moved.coordinates()[0] != measuring.coordinates()[0]

    blind = Seen.of(EnergyShaping.tuned(plant), plant, at)
    assert blind.measured.external_force is None
    shown = Seen.of(EnergyShaping.tuned(plant), plant, at, ("total_force",))
    x = plant.at(at.position, at.velocity)
    np.testing.assert_allclose(shown.measured.total_force, x.total_force(at.force))
    np.testing.assert_array_equal(shown.command().torque, blind.command().torque)
