"""Every law on PERA and Panda, beyond its limits and into a wall: outside without the filter, inside with it."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from phcontrol import FilterStatus, load_robot

EXAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "limits.py"))
run, violations = EXAMPLE["run"], EXAMPLE["violations"]
BUMP = 0.05  # of the velocity limits: what a wall can do within a period
THROW = 1.0  # likewise, where the motors may not turn their torque at once [rad/s]
GROWTH = 1e-3  # of the largest H_d: terms of third order in the period, and what the external force does within one


@pytest.mark.parametrize("torque_rate", [None, 1000.0], ids=["any-rate", "limited-rate"])
@pytest.mark.parametrize("wall", [False, True], ids=["goal", "wall"])
@pytest.mark.parametrize("arm", ["pera", "panda"])
@pytest.mark.parametrize("law", EXAMPLE["LAWS"])
def test_the_filter_keeps_every_law_inside_the_limits(law, arm, wall, torque_rate):
    log = run(law, arm, wall, True, duration=0.4, torque_rate=torque_rate)
    found = violations(log, arm)
    assert found.torque <= 1e-9
    assert found.position == 0.0
    if law not in EXAMPLE["POSES"] or not wall:
        assert found.velocity <= ((BUMP if torque_rate is None else THROW) if wall else 1e-2)
    assert found.thrown <= (BUMP if wall else 1e-2)  # whatever the wall does more is reported
    assert found.unreported <= GROWTH
    if not law.startswith(("tracking", "cartesian")):  # whose own trajectory may keep the limits
        assert (log.filter_activity["status"] > FilterStatus.PASSED).any()
    assert found.fallbacks <= 2
    if torque_rate is not None:
        steps = np.abs(np.diff(log.torque[:-1], axis=0)).max()
        assert steps <= torque_rate * EXAMPLE["PERIOD"] + 1e-9


@pytest.mark.parametrize("margin", [0.1, 0.3])
def test_a_stiff_wall_throws_an_arm_that_comes_with_all_joints_at_their_limits(margin):
    """A Cartesian law on a Panda. The force comes to twice the first joint's effort, and is known as it is only.

    The filter asks for what the next period needs, and reports what no torque can keep; slower, the arm keeps its
    limits through the same contact.
    """
    log = run("cartesian_impedance", "panda", True, True, duration=0.25, velocity_margin=margin)
    found = violations(log, "panda")
    effort = load_robot("panda").effort_limit[0]
    assert np.abs(log.external_force[:, 0]).max() > 1.9 * effort
    assert found.thrown == 0.0
    if margin == 0.1:
        assert 0.9 < found.velocity < log.filter_activity["motion_excess"].max() < 1.5
    else:
        assert found.velocity == 0.0
