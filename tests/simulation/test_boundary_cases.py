"""Fixed points that do not contract, runs without bodies, periods that a law allows."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import EnergyShaping, InvalidArgumentError, simulate
from phcontrol.exceptions import PHControlError
from phcontrol.simulation.fixed_point import fixed_point
from phcontrol.simulation.sampled_control import SampledControl
from tests.conftest import make_system


def test_a_fixed_point_that_does_not_contract_is_found_to_rounding():
    """z = 3 cos z has the slope −2.6 at its solution: iteration leads away."""
    found = fixed_point(lambda z: 3.0 * np.cos(z), np.array([1.0, 1.3]), "none")
    np.testing.assert_allclose(found, np.full(2, 1.170120950002626), rtol=1e-11)
    with pytest.raises(PHControlError, match="none there"):
        fixed_point(lambda z: np.where(z > 0.0, -1.0, 1.0), np.zeros(2), "none there")


def test_a_run_without_bodies_touches_nothing():
    system = make_system("pera_shoulder")
    log = simulate(system, EnergyShaping.tuned(system), duration=0.02, dt=1e-3, progress=False)
    for name in ("contact_force", "contact_energy", "contact_power"):
        np.testing.assert_array_equal(getattr(log, name), np.zeros(len(log)))
    assert log.contact_forces.shape == log.contact_depths.shape == (len(log), 0)
    expected = np.einsum("ki,ki->k", log.velocity, log.torque)
    np.testing.assert_allclose(log.control_power, expected, atol=1e-15)


def test_a_period_may_be_as_long_as_a_law_allows_and_no_longer():
    class Hasty(EnergyShaping):
        longest_period = 2e-3

    law = Hasty.tuned(make_system("pera_shoulder"))
    assert SampledControl(law, 2e-3).period == 2e-3
    with pytest.raises(InvalidArgumentError, match="period: must be at most 0.002 s"):
        SampledControl(law, 2.2e-3)
