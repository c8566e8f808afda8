"""Every law on PERA and Panda, beyond its limits and into a wall: outside without the filter, inside with it."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from phcontrol import FilterStatus

EXAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "limits.py"))
run, violations = EXAMPLE["run"], EXAMPLE["violations"]
BUMP = 0.05  # of the velocity limits: what a wall can do within a period


@pytest.mark.parametrize("wall", [False, True], ids=["goal", "wall"])
@pytest.mark.parametrize("arm", ["pera", "panda"])
@pytest.mark.parametrize("law", EXAMPLE["LAWS"])
def test_the_filter_keeps_every_law_inside_the_limits(law, arm, wall):
    log = run(law, arm, wall, True, duration=0.4)
    found = violations(log, arm)
    assert found.torque <= 1e-9
    assert found.position == 0.0
    assert found.velocity <= (BUMP if wall else 1e-2)
    if not law.startswith("tracking"):  # whose own trajectory may keep the limits
        assert (log.filter_activity["status"] > FilterStatus.PASSED).any()
    assert found.fallbacks <= 2
