"""What a law is told within the vector field: what limits changed of its torque, and what there is to see at a jump."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import Measured, make_controller
from phcontrol.simulation.vector_field import ClosedLoop
from tests.conftest import make_system


@pytest.fixture
def told(monkeypatch):
    """A loop under limits of 2 and 300 N·m, and what its law was told."""
    system = make_system("pera_shoulder")
    law = make_controller("force_feedback", system, [0.5, -0.5])
    seen: dict[str, list] = {"change": [], "jump": []}

    def rate_under_limits(t, x, state, rate, change, measured):
        seen["change"].append(change)
        return rate + 7.0

    def jump(t, x, state, measured):
        seen["jump"].append(measured)
        return state + 1.0

    monkeypatch.setattr(law, "rate_under_limits", rate_under_limits)
    monkeypatch.setattr(law, "jump", jump)
    force = np.array([0.3, -0.2])
    limits, y = np.array([2.0, 300.0]), np.array([0.1, 0.2, 0.3, -0.4, 0.05, -0.06])
    free = ClosedLoop(system, law, force, None).evaluate(0.0, y)
    return ClosedLoop(system, law, force, limits), free, limits, y, seen


def test_a_law_is_told_what_its_limits_changed(told):
    """Clipped less desired, as a force that acts beside what the law asked for; its state then goes its own way."""
    loop, free, limits, y, seen = told
    assert seen["change"] == []
    assert abs(free.torque[0]) > 2.0
    assert abs(free.torque[1]) < 300.0
    limited = loop.evaluate(0.0, y)
    np.testing.assert_array_equal(limited.torque, np.clip(free.torque, -limits, limits))
    np.testing.assert_allclose(seen["change"][-1], limited.torque - free.torque, atol=1e-15)
    np.testing.assert_allclose(limited.rate[4:], free.rate[4:] + 7.0, atol=1e-14)
    np.testing.assert_array_equal(loop.torque(0.0, y), limited.torque)


def test_a_jump_sees_what_is_measured_or_else_the_truth(told):
    loop, _, _, y, seen = told
    shown = Measured(external_force=np.array([9.0, 8.0]))
    for measured, force in ((shown, [9.0, 8.0]), (None, [0.3, -0.2])):
        after = loop.jump(0.0, y, measured)
        np.testing.assert_array_equal(after, [*y[:4], *(y[4:] + 1.0)])
        np.testing.assert_array_equal(seen["jump"][-1].external_force, force)
    assert y[4] == 0.05  # the state that was given stays
