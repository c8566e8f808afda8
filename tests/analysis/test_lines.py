"""Lines between states: through time, or at one time."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import EnergyShaping, MechanicalSystem, make_controller
from phcontrol.analysis.lines import lines_of
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.rest_point import find_rest
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.state_sampler import StateSampler
from tests.conftest import make_system
from tests.controllers.arms import chain


@pytest.mark.parametrize(("law", "changes"), [("tracking", True), ("energy_shaping", False)])
def test_every_second_chord_of_a_law_that_changes_runs_through_time(law, changes):
    system = make_system("pera_shoulder")
    made = make_controller(law, system)
    units = NaturalUnits.of(made, system, 0.0)
    rest = find_rest(made, system, units, 0.0)
    sampler = StateSampler(made, system, units, (rest.position, rest.velocity, rest.state), rest.force)
    states = sampler.draw(32, 3)
    chords = [line for line in lines_of(made, system, units, rest, states) if not line.into_rest]
    assert len(chords) > 10
    for k, chord in enumerate(chords):
        start, end = states[2 * k : 2 * k + 2]
        times = [seen.at.time for seen in chord._seen]
        assert times[0] == start.time
        assert times[-1] == pytest.approx(end.time if changes and k % 2 else start.time)
        np.testing.assert_array_equal(chord._seen[0].at.position, start.position)
        np.testing.assert_allclose(chord._seen[-1].at.position, end.position, atol=1e-9)


def test_a_command_that_is_linear_is_odd_nowhere_on_a_ray():
    """u = −K q − C q̇ of a joint that feels no weight: over the distance from rest it is the same at every distance."""
    system = MechanicalSystem(chain(1).robot, gravity=[0.0, 0.0, 0.0])
    law = EnergyShaping(system, goal=[0.0], stiffness=2.0, damping=0.5)
    units = NaturalUnits.of(law, system, 0.0)
    states = [SampledState(0.0, np.array([0.1 * k]), np.ones(1), np.zeros(0), np.zeros(1), None, "") for k in range(32)]
    lines = lines_of(law, system, units, find_rest(law, system, units, 0.0), states)
    rays = [line for line in lines if line.into_rest and not line._start.at.velocity.any()]
    assert len(rays) > 2
    for ray in rays:
        assert ray.oddest() == (0.0, [])
