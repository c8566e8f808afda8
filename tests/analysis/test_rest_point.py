"""Where a law rests: the curvature of H_d there, and what is zero of a loop that goes along with its reference."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    Command,
    Controller,
    EnergyShaping,
    Gain,
    MechanicalSystem,
    Sinusoid,
    Target,
    TrajectoryTracking,
    certify,
    load_robot,
    make_controller,
)
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.neighbourhood import Neighbourhood
from phcontrol.analysis.rest_point import find_rest
from phcontrol.analysis.runs import run_states
from tests.conftest import make_system


def rest_of(law, plant):
    units = NaturalUnits.of(law, plant, 0.0)
    return units, find_rest(law, plant, units, 0.0)


def test_the_curvature_is_the_least_eigenvalue_of_the_scaled_hessian():
    """On (q, p̂) it is diag(K_p, 1): with a unit diagonal 1 less the correlation of the two joints."""
    system = make_system("pera_shoulder")
    _, rest = rest_of(EnergyShaping(system, goal=[0.1, 0.2], stiffness=[[20.0, 9.0], [9.0, 12.0]], damping=1.0), system)
    assert rest.found
    assert rest.curvature == pytest.approx(1.0 - 9.0 / np.sqrt(20.0 * 12.0), abs=1e-7)


def test_a_law_that_lacks_a_minimum_has_no_curvature():
    system = make_system("pera_shoulder")
    _, rest = rest_of(make_controller("force_control", system, force=[2.0, -1.0]), system)
    assert rest.found
    assert np.isnan(rest.curvature)


class Together(Controller):
    """A spring on the sum of both joints: what turns them against each other, no coordinate tells."""

    name = "together"
    damping: Gain = Gain("C", "N·m·s/rad")

    def rest_posture(self, t):
        return np.array([0.2, 0.1])

    def storage(self, t, x, state, measured=NOTHING):
        return x.kinetic_energy + 0.5 * (x.position.sum() - 0.3) ** 2

    def target(self, t, x, state, measured=NOTHING):
        error, p = np.array([x.position.sum() - 0.3]), x.transformed_momentum
        return Target.of(
            {"error": (error, error), "momentum": (p, p)},
            lambda: {
                ("error", "momentum"): np.ones((1, 2)) @ x.inverse_factor.T,
                ("momentum", "momentum"): x.interconnection(self.interconnection),
            },
            lambda: {("momentum", "momentum"): x.transformed_damping + x.transformed_injection(self.damping)},
            lambda: {"momentum": x.inverse_factor},
        )


class WithoutPromise(Together):
    """The target has no coordinates: everything keeps that."""

    name = "without_promise"

    def coordinates(self, t, x, state, measured=NOTHING):
        return np.zeros(0)

    def target(self, t, x, state, measured=NOTHING):
        return Target(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros((0, 2)))

    def evaluate(self, t, x, state, measured=NOTHING):
        return Command(x.potential_gradient - x.velocity, np.zeros(0))


def test_where_the_coordinates_do_not_tell_all_that_moves_there_is_no_curvature():
    system = make_system("pera_shoulder")
    _, rest = rest_of(Together(system, damping=1.0), system)
    assert rest.found
    assert rest.curvature == 0.0
    certificate = certify(Together(system, damping=1.0), samples=16)
    assert certificate.error == ""  # it once was that a matrix is not square
    assert not certificate["smallest curvature of H_d at rest"].passed


def test_a_promise_without_coordinates_has_no_curvature():
    system = make_system("pera_shoulder")
    _, rest = rest_of(WithoutPromise(system, damping=1.0), system)
    assert rest.curvature < 1e-9


def test_along_a_reference_the_drift_of_a_law_that_follows_it_is_0():
    """ẏ less (q̇_ref, q̈_ref), where q̈_ref is known: of a sinusoid at two times."""
    system = MechanicalSystem(load_robot("pera_shoulder"))
    way = Sinusoid([0.3, 0.2], [0.5, 0.8], offset=[0.3, 0.2])
    law = TrajectoryTracking.tuned(system, trajectory=way)
    units, nothing = NaturalUnits.of(law, system, 0.0), np.zeros(2)
    for time in (0.4, 1.1):
        point = way.at(time)
        assert np.abs(point.acceleration).max() > 0.1
        around = Neighbourhood(law, system, units, time, nothing)
        y = np.concatenate([point.position, point.velocity])
        np.testing.assert_allclose(around.drift(y), 0.0, atol=1e-8)
        np.testing.assert_allclose(around.rate(y), np.concatenate([point.velocity, point.acceleration]), atol=1e-9)


@pytest.mark.parametrize(("name", "away"), [("energy_shaping", 0.3), ("hamiltonian_servo", 0.02)])
def test_one_run_starts_with_the_last_joint_alone_away_from_rest_by_its_own_unit(name, away):
    """The finger's is 0.3 m, that of the joints that turn 1 rad."""
    plant = make_system("panda_with_fingers")
    law = make_controller(name, plant)
    units, rest = rest_of(law, plant)
    _, logs = run_states(law, plant, units, rest)
    start = logs[1].position[0] - rest.position
    np.testing.assert_allclose(start, [0.0] * 7 + [away * 0.3], atol=1e-12)
