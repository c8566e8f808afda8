"""The quadratic by which a torque filter bounds the growth of H_d, against its own finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol.controllers.passive_port import PassivePort
from phcontrol.safety.storage_condition import StorageCondition


@pytest.mark.parametrize("gears", [False, True])
def test_slope_and_curvature_are_those_of_the_power(gears):
    """κ moves with the torque by E: P is quadratic in u, so that differences of second order are exact."""
    generator, n = np.random.default_rng(0), 3
    matrix = np.eye(n) + 0.3 * generator.normal(size=(n, n)) if gears else None
    port = PassivePort(generator.normal(size=n), 0.7, generator.normal(size=n))
    condition = StorageCondition(port, matrix)
    inertia = np.eye(n) + 0.1 * np.ones((n, n))
    effect = 1e-3 * np.linalg.solve(inertia, np.eye(n) if matrix is None else matrix)
    change, kick = generator.normal(size=n), generator.normal(size=n)

    def power(step):
        return condition.power(change + step, kick + effect @ step)

    centre, reach = generator.normal(size=n), generator.uniform(0.5, 2.0, size=n)
    constraint = condition.scaled(1.3, change, kick, effect, centre, reach)
    size = 1.3 / constraint.excess
    for z in generator.normal(size=(20, n)):
        grown = power((z - centre) * reach) - power(np.zeros(n))
        assert size * constraint.value(z) == pytest.approx(1.3 + grown, rel=1e-9)


def test_what_is_allowed_is_what_sampling_alone_does():
    """At u★ itself P = −½κ★ᵀr − losses: never less than nothing is allowed."""
    kick = np.array([0.2, -0.4])
    gaining = StorageCondition(PassivePort(np.ones(2), 0.1, np.array([1.0, 5.0])), None)
    assert gaining.allowed(kick) == pytest.approx(0.9 - 0.1)
    assert gaining.allowed(kick) == pytest.approx(gaining.power(np.zeros(2), kick))
    losing = StorageCondition(PassivePort(np.ones(2), 2.0, np.array([1.0, 5.0])), None)
    assert losing.allowed(kick) == 0.0
