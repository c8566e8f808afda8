"""What the study of the theorems measures, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import EnergyShaping, MechanicalSystem, load_robot
from phcontrol.thesis.theorems import loop_gain, storage_rate


def test_the_rate_of_the_storage_function_is_that_of_a_spring_and_a_damper():
    system = MechanicalSystem(load_robot("pera_shoulder"))
    law = EnergyShaping(system, goal=[1.0, 0.5], stiffness=15.0, damping=10.0)
    rng = np.random.default_rng(2)
    for _ in range(5):
        q, v, force = rng.normal(size=(3, 2))
        friction = system.at(q, v).damping
        expected = -v @ (friction * v) - 10.0 * v @ v + v @ force
        assert storage_rate(law, q, v, np.zeros(0), force) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("damping", [5.0, 20.0])
def test_the_gain_of_the_loop_is_one_over_the_damping(damping):
    """At the frequency at which force feedback lets nothing but C hold the arm; friction cannot help there."""
    assert loop_gain(damping) == pytest.approx(1.0 / damping, rel=1e-3)
