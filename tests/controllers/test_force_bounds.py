"""The conditions of Theorem 4.1.1: the printed ones from norms, the real one where nothing but ε decides."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, MechanicalSystem, force_control_conditions, load_robot, make_controller
from phcontrol.analysis.force_conditions import ForceConditions
from tests.conftest import make_system


def bounds(*matrices):
    """Smallest and largest gain of any of the matrices, by NumPy's spectral norms."""
    return min(np.linalg.norm(m, -2) for m in matrices), max(np.linalg.norm(m, 2) for m in matrices)


def test_the_printed_conditions_from_the_bounds_over_the_states():
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"), input_matrix=np.diag([1.0, 2.0, 0.5]))
    law = make_controller("force_control", system, damping=[3.0, 4.0, 6.0], coupling=[0.5, 0.7, 0.9],
                          force_gain=[1.5, 2.0, 3.5])  # fmt: skip
    low, high = np.full(3, -0.4), np.full(3, 0.6)
    found = force_control_conditions(law, system, lower=low, upper=high, speed=0.8, samples=4, seed=5)
    generator = np.random.default_rng(5)
    states = [system.at(generator.uniform(low, high), generator.uniform(-0.8, 0.8, 3)) for _ in range(4)]
    d1, d2 = bounds(*(x.transformed_damping for x in states))
    g1, g2 = bounds(*(x.transformed_input for x in states))
    (c1, c2), (k1, k2), (y1, y2) = (3.0, 6.0), (1.5, 3.5), (0.75, 3.15)
    expected = (
        sqrt(1.0 / k1),
        (y2 * d2 * k1) / (y1 * d1 * sqrt(k2)),
        y1 / y2 * sqrt((d1 + c1 * g1**2) * d1 * k2 / ((d2 + c2 * g2**2) * d2 * k1)),
    )
    np.testing.assert_allclose(found.printed, expected, rtol=1e-9)
    assert found.positive == pytest.approx(1.0 / sqrt(3.5))
    assert found.samples == 4
    again = force_control_conditions(law, system, lower=low, upper=high, speed=0.8, samples=4, seed=6)
    assert again.printed != found.printed


def test_the_smaller_of_both_bounds_is_the_one_of_the_proof():
    for positive, decreasing, largest, passed in [
        (0.5, 0.2, 0.2, True),
        (0.1, np.inf, 0.1, True),
        (0.5, 0.0, 0.0, False),
    ]:
        conditions = ForceConditions(positive, decreasing, (1.0, 1.0, 1.0), 1)
        assert (conditions.largest, conditions.passed) == (largest, passed)
    gripper = make_system("pera_gripper")
    assert force_control_conditions(make_controller("force_control", gripper), gripper, samples=1).passed


def test_the_usual_box_is_that_of_the_limits_at_a_radian_a_second():
    system = make_system("pera_shoulder")
    law = make_controller("force_control", system)
    usual = force_control_conditions(law, system)
    limits = {"lower": system.robot.lower, "upper": system.robot.upper}
    assert usual == force_control_conditions(law, system, speed=1.0, samples=200, seed=0, **limits)
    kinova = make_system("kinova")
    with pytest.raises(InvalidArgumentError, match="has joints without limits: give lower and upper"):
        force_control_conditions(make_controller("force_control", kinova), kinova)
    for box in ({"lower": np.full(6, -0.1)}, {"upper": np.full(6, 0.1)}):
        with pytest.raises(InvalidArgumentError, match="has joints without limits"):
            force_control_conditions(make_controller("force_control", kinova), kinova, **box)
    point = force_control_conditions(law, system, lower=[0.1, 0.2], upper=[0.1, 0.2], samples=1)  # a box may be a point
    assert point.samples == 1
