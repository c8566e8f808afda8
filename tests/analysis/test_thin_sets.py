"""Laws that are wrong on sets without a volume only, and the states by which they are found."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from phcontrol import (
    EnergyShaping,
    ForceControl,
    ForceFeedback,
    ImpedanceGrasping,
    IntegralAction,
    TotalForceRejection,
    TrajectoryTracking,
    certify,
    make_controller,
)
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.state_sampler import StateSampler
from phcontrol.analysis.thin_states import SLIDING, _blocks
from phcontrol.sensors.measured import measure_truly
from tests.analysis.test_wrong_laws import wrong
from tests.conftest import make_system


def away(law, x):
    return np.abs(x.position_error(law.goal))


def only_the_wrist(law, t, x, state, measured):
    return away(law, x)[:3].max() < 1e-9 and away(law, x)[3:].min() > 0.1


def only_the_first_joints_move(law, t, x, state, measured):
    still = ~x.velocity.astype(bool)
    return not still[:2].any() and still[-1] and away(law, x)[-1] < 1e-9 and away(law, x)[:2].min() > 0.1


def sliding(law, t, x, state, measured):
    return np.abs(law.target(t, x, state, measured).momentum).max() < 1e-9 and np.abs(state).max() > 0.1


def one_joint_pushed(law, t, x, state, measured):
    force = measured.external_force
    return abs(force[2]) > 0.5 and not np.delete(force, 2).any() and not x.velocity.any() and not state.any()


def one_state_charged(law, t, x, state, measured):
    return abs(state[4]) > 0.1 and not np.delete(state, 4).any() and not x.velocity.any() and not away(law, x).any()


def at_rest_under_a_load(law, t, x, state, measured):
    force = measured.external_force
    left = x.position_error(law.goal) - np.linalg.solve(law.stiffness, force)
    return not x.velocity.any() and np.abs(left).max() < 1e-9 and np.abs(force).max() > 0.1


def integral_bears_a_load(law, t, x, state, measured):
    return not x.velocity.any() and not away(law, x).any() and np.abs(state[7:]).min() > 0.1 and not state[:7].any()


def weight_in_the_hand(law, t, x, state, measured):
    force = measured.external_force
    lever = x.frame_jacobian(x.system.robot.tool_frame, "local_world_aligned")[2]
    weight = -force @ lever / (lever @ lever)
    return weight > 1.0 and np.linalg.norm(force + weight * lever) < 1e-6 * np.linalg.norm(force)


def close_to_the_desired_force(law, t, x, state, measured):
    return 0.0 < np.linalg.norm(measured.external_force - law.desired.gradient(x)) < 0.1


PRESSING = {"force": [0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 1.0]}
WRONG = {
    "only the wrist away": (EnergyShaping, "ur5", only_the_wrist, {}),
    "only the first joints move": (EnergyShaping, "pera", only_the_first_joints_move, {}),
    "momentum 0, force feedback": (ForceFeedback, "pera", sliding, {}),
    "momentum 0, integral action": (IntegralAction, "panda", sliding, {}),
    "one joint pushed, at rest": (ImpedanceGrasping, "pera", one_joint_pushed, {}),
    "one state charged": (ForceFeedback, "pera", one_state_charged, {}),
    "rest under a load, measured": (ForceFeedback, "pera", at_rest_under_a_load, {"measured": True}),
    "rest under a load, in the integral": (IntegralAction, "pera", integral_bears_a_load, {}),
    "a weight in the hand": (ForceFeedback, "pera", weight_in_the_hand, {"measured": True}),
    "close to the desired force": (ForceControl, "pera", close_to_the_desired_force, PRESSING),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_law_that_is_wrong_on_a_thin_set_gets_no_certificate(name):
    law, arm, where, options = WRONG[name]
    certificate = certify(wrong(law, where).tuned(make_system(arm), **options))
    assert not certificate["matching residual"].passed, str(certificate)


@pytest.mark.parametrize("name", WRONG)
def test_the_right_law_does(name):
    law, arm, _, options = WRONG[name]
    assert certify(law.tuned(make_system(arm), **options)).passed


# --- the states themselves ------------------------------------------------------------------------------


@cache
def drawn(law, arm, form="coriolis", samples=256):
    """Return a law, its plant and the states on thin sets of a certificate."""
    plant = make_system(arm)
    made = make_controller(law, plant, interconnection=form)
    units = NaturalUnits.of(made, plant, 0.0)
    goal = made.rest_posture(0.0)
    rest = (goal, np.zeros(plant.n), np.zeros(made.state_size))
    return made, plant, StateSampler(made, plant, units, rest, np.zeros(plant.n)).draw(samples, 3)[samples:]


def acceleration(law, plant, at):
    x = plant.at(at.position, at.velocity)
    torque = law.evaluate(at.time, x, at.state, measure_truly(x, at.force, law.needs)).torque
    return x.acceleration(torque, at.force)


@pytest.mark.parametrize("law", ["force_feedback", "force_feedback_measured", "integral_action", "tracking"])
def test_the_momentum_is_0_where_the_law_slides(law):
    made, plant, states = drawn(law, "panda")
    sliding = [at for at in states if at.stratum == SLIDING]
    assert len(sliding) == 8
    for at in sliding:
        x = plant.at(at.position, at.velocity)
        coordinates = made.coordinates(at.time, x, at.state)
        assert np.abs(coordinates[plant.n : 2 * plant.n]).max() < 1e-12
        assert np.abs(at.velocity).max() > 1e-3
        assert (np.abs(at.velocity) <= 2.0 * plant.robot.velocity_limit * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback_measured", "integral_action"])
def test_the_force_balances_at_rest_under_a_load(law):
    made, plant, states = drawn(law, "pera")
    loaded = [at for at in states if at.stratum == "at rest under a load"]
    assert len(loaded) == 8
    for at in loaded:
        assert not at.velocity.any()
        assert np.abs(acceleration(made, plant, at)).max() < 1e-9
        assert np.abs(at.force).max() > 1e-4
        assert (np.abs(at.force) <= 2.0 * plant.robot.effort_limit * (1.0 + 1e-9)).all()


def test_every_coordinate_is_once_alone_away_from_rest():
    made, plant, states = drawn("force_feedback", "pera")
    seen = set()
    for at in states:
        fields = at.position - made.goal, at.velocity, at.force, at.state
        changed = [(name, *np.flatnonzero(part)) for name, part in zip("qvfz", fields, strict=True) if part.any()]
        if len(changed) == 1 and len(changed[0]) == 2:
            seen.add(changed[0])
    assert seen == {(name, entry) for name in "qvfz" for entry in range(7)}


def test_every_end_of_the_arm_is_once_alone_away_from_the_goal():
    made, _, states = drawn("force_feedback", "pera")
    blocks = set()
    for at in states:
        joints = np.flatnonzero(at.position - made.goal)
        if 1 < len(joints) < 7 and "alone" in at.stratum:
            assert (np.diff(joints) == 1).all()
            assert set(np.flatnonzero(at.velocity)) <= set(joints)
            blocks.add((int(joints[0]), int(joints[-1])))
    assert {(7 - k, 6) for k in range(2, 7)} <= blocks
    assert {(0, k - 1) for k in range(2, 7)} <= blocks


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7])
def test_blocks_are_all_neighbours_but_not_all_joints_each_once(n):
    blocks = [(block.start, block.stop) for block in _blocks(n)]
    assert sorted(blocks) == [(a, b) for a in range(n) for b in range(a + 2, n + 1) if b - a < n]


def test_a_rest_is_approached_over_six_decades_and_by_two_joints_over_the_last_two():
    made, _, states = drawn("energy_shaping", "panda")
    close = [np.abs(at.position - made.goal) for at in states if "from rest, " in at.stratum]
    assert len(close) == 256 // 6
    pairs = [away.max() for away in close if np.count_nonzero(away) == 2]
    everywhere = [away.max() for away in close if np.count_nonzero(away) == 7]
    assert len(pairs) == len(everywhere) == len(close) // 2
    assert 0.2 * 1e-2 <= min(pairs) < 1e-1 < max(pairs) <= 1.0
    decades = np.floor(np.log10(np.array(everywhere)))  # of the largest of seven numbers up to the distance
    assert set(range(-6, 0)) <= set(decades.astype(int)) <= set(range(-7, 0))


def test_a_force_that_a_law_cancels_balances_nothing_and_is_left_out():
    """f_e does not move a loop that rejects it: the state is drawn at rest without a load."""
    made, plant, states = drawn("total_force_rejection", "pera")
    assert isinstance(made, TotalForceRejection)
    for at in states:
        assert np.isfinite(at.force).all()
        assert (np.abs(at.force) <= 2.0 * plant.robot.effort_limit * (1.0 + 1e-9)).all()


def test_states_about_a_reference_move_with_it():
    made, _, states = drawn("tracking", "pera")
    assert isinstance(made, TrajectoryTracking)
    assert len({at.time for at in states}) > 40
    for at in states:
        if at.stratum.endswith("of the position"):
            point = made.trajectory.at(at.time)
            assert np.count_nonzero(np.abs(at.position - point.position) > 1e-9) == 1
            np.testing.assert_allclose(at.velocity, point.velocity, atol=1e-6)


@pytest.mark.parametrize("samples", [17, 50, 77])
def test_any_number_of_states_can_be_drawn(samples):
    """The last turn through the kinds of states may be begun only: it once looked past the last axis."""
    system = make_system("pera_shoulder")
    certificate = certify(make_controller("energy_shaping", system), samples=samples)
    assert certificate.error == ""
    assert certificate.passed
