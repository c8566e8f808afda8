"""The states that a certificate looks at: that each kind which is promised occurs, and is what it is called."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from phcontrol import make_controller
from phcontrol.analysis.empty_scene import EmptyScene
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.state_sampler import StateSampler
from tests.conftest import make_system

SAMPLES = 1024
PLACES = (
    "at the goal", "near the goal", "some joints at the goal", "near home", "at joint limits", "all joints alike",
    "beyond joint limits",
)  # fmt: skip


@cache
def drawn(law, arm, seed=3, samples=SAMPLES, load=0.0, lost=None):
    """Return a law, its plant and units and the states that are drawn for it; ``load`` is what it rests under."""
    plant = make_system(arm)
    made = make_controller(law, plant, **({} if lost is None else {"lost": lost}))
    units = NaturalUnits.of(made, plant, 0.0)
    goal = made.rest_posture(0.0)
    rest = (goal, np.zeros(plant.n), np.zeros(made.state_size))
    sampler = StateSampler(made, plant, units, rest, load * units.force)
    return made, plant, units, sampler.draw(samples, seed)


def seen(law, arm, word):
    """Return the states of a stratum; of those that have no word for where they are, for ``anywhere``."""
    states = drawn(law, arm)[3][1:SAMPLES]
    words = [at.stratum.split(", ") for at in states]
    if word == "anywhere":
        return [at for at, said in zip(states, words, strict=True) if not set(said) & set(PLACES)]
    return [at for at, said in zip(states, words, strict=True) if word in said]


def positions(arm, word):
    """Return the positions of a stratum, shape (count, n)."""
    return np.array([at.position for at in seen("energy_shaping", arm, word)])


def limits(arm):
    robot = make_system(arm).robot
    bounded = np.isfinite(robot.lower)
    return np.where(bounded, robot.lower, -np.pi), np.where(bounded, robot.upper, np.pi)


def test_how_many_and_from_which_seed():
    assert len(drawn("energy_shaping", "panda")[3]) == SAMPLES + SAMPLES // 4 + SAMPLES // 6
    first, again, other = (drawn.__wrapped__("energy_shaping", "panda", seed, 64)[3] for seed in (3, 3, 4))
    for field in ("position", "velocity", "force"):
        values = [np.array([getattr(at, field) for at in states]) for states in (first, again, other)]
        np.testing.assert_array_equal(values[0], values[1])
        assert (values[0] != values[2]).any(axis=1).mean() > 0.3


def test_the_first_is_the_rest_point():
    made, plant, units, states = drawn("force_feedback", "panda", 3, 64, 0.25)
    assert states[0].stratum == "the rest point"
    assert states[0].time == 0.0
    np.testing.assert_array_equal(states[0].position, made.goal)
    np.testing.assert_array_equal(states[0].velocity, np.zeros(plant.n))
    np.testing.assert_array_equal(states[0].force, 0.25 * units.force)


@pytest.mark.parametrize("arm", ["panda", "kinova"])
def test_every_place_occurs(arm):
    counts = {where: len(seen("energy_shaping", arm, where)) for where in PLACES}
    assert min(counts.values()) >= 0.01 * SAMPLES, counts
    assert 0.2 * SAMPLES < len(seen("energy_shaping", arm, "anywhere")) < 0.4 * SAMPLES


def test_the_goal_and_near_it_on_all_scales():
    goal = drawn("energy_shaping", "panda")[0].goal
    assert (positions("panda", "at the goal") == goal).all()
    away = positions("panda", "near the goal") - goal
    distances = np.sort(np.abs(away).max(axis=1))
    assert 1e-7 < distances[0] < 1e-5
    assert 0.5 < distances[-1] <= 1.0
    assert 1e-4 < np.median(distances) < 1e-2  # as many below 1e-3 as above
    assert (away > 0.0).mean() == pytest.approx(0.5, abs=0.1)
    some = np.abs(positions("panda", "some joints at the goal") - goal)
    assert ((some == 0.0).any(axis=1) & (some > 0.0).any(axis=1)).mean() > 0.9
    assert (np.count_nonzero(some, axis=1) == 1).mean() > 0.15
    assert 1.0 < some.max() <= 1.5


def test_about_home_and_on_the_way_from_there():
    made, plant, _, _ = drawn("energy_shaping", "panda")
    shares = np.linspace(0.0, 1.0, 401)[:, None]
    ways = [start + shares * (made.goal - start) for start in (plant.robot.home, np.zeros(plant.n))]
    for position in positions("panda", "near home"):
        assert min(np.abs(way - position).max(axis=1).min() for way in ways) < 0.11
    near = np.abs(positions("panda", "near home") - plant.robot.home).max(axis=1) < 0.1
    assert near.mean() > 0.3
    zero = np.abs(positions("panda", "near home")).max(axis=1) <= 0.1
    assert zero.mean() > 0.1


@pytest.mark.parametrize("arm", ["panda", "kinova"])
def test_on_joint_limits_and_close_to_them_on_both_sides(arm):
    """The distances to the next limit, positive outside, of joints that have one."""
    robot = make_system(arm).robot
    bounded = np.isfinite(robot.lower)
    at, low, high = positions(arm, "at joint limits")[:, bounded], robot.lower[bounded], robot.upper[bounded]
    outside = np.where(at > 0.5 * (low + high), at - high, low - at) / (high - low)
    close = np.abs(outside) < 0.05
    assert close.any(axis=1).mean() > 0.85
    assert 0.3 < close.mean() < 0.8
    for side in (outside[close] == 0.0, outside[close] > 0.0, outside[close] < 0.0):
        assert side.mean() > 0.15
    for which in (at > 0.5 * (low + high), at < 0.5 * (low + high)):
        assert (close & which).mean() > 0.3 * close.mean()
    away = np.abs(outside[close & (outside != 0.0)])
    assert away.min() < 1e-6
    assert 1e-5 < np.median(away) < 1e-3  # half way between 0.05e-6 and 0.05, on a logarithmic scale
    assert outside[~close].max() < 0.0
    if bounded.all():
        together = [(at == limit).all(axis=1).mean() for limit in (low, high)]
        assert min(together) > 0.01


@pytest.mark.parametrize("arm", ["panda", "kinova"])
def test_anywhere_and_beyond(arm):
    low, high = limits(arm)
    share = (positions(arm, "anywhere") - low) / (high - low)
    assert ((share >= 0.0) & (share <= 1.0)).all()
    for edge in (0.25, 0.5, 0.75):  # even in each joint
        np.testing.assert_allclose((share < edge).mean(axis=0), edge, atol=0.03)
    alike = (positions(arm, "all joints alike") - low) / (high - low)
    np.testing.assert_allclose(alike - alike[:, :1], 0.0, atol=1e-12)
    assert alike.min() >= 0.0
    assert alike.max() <= 1.0
    beyond = (positions(arm, "beyond joint limits") - 0.5 * (low + high)) / (high - low)
    most = np.where(np.isfinite(make_system(arm).robot.lower), 0.6, 3.5)  # a tenth, or three turns
    assert (np.abs(beyond) <= most).all()
    assert (np.abs(beyond).max(axis=0) > 0.9 * most).all()
    np.testing.assert_allclose((beyond < 0.0).mean(axis=0), 0.5, atol=0.05)


def test_speeds():
    _, plant, units, states = drawn("energy_shaping", "panda")
    moving = {
        word: [at.velocity for at in seen("energy_shaping", "panda", word)] for word in ("at rest", "slow", "fast")
    }
    assert not np.any(moving["at rest"])
    slow = np.abs(np.array(moving["slow"]) / units.speed).max(axis=1)
    assert 1e-7 < slow.min() < 1e-5
    assert 0.3 < slow.max() <= 1.0
    assert 1e-5 < np.median(slow) < 1e-2
    fast = np.abs(np.array(moving["fast"]))
    assert fast.max() > 10.0  # [rad/s]
    assert np.median((fast / units.speed).max(axis=1)) > 1.0
    usual = np.array(
        [
            at.velocity / units.speed
            for at in states[1:SAMPLES]
            if not {"at rest", "slow", "fast"} & set(at.stratum.split(", "))
        ]
    )
    assert 1.9 < np.abs(usual).max() <= 2.0
    assert (usual[usual != 0.0] > 0.0).mean() == pytest.approx(0.5, abs=0.05)
    assert (np.count_nonzero(usual, axis=1) == 1).mean() == pytest.approx(0.25, abs=0.06)
    assert (np.count_nonzero(usual, axis=1) == plant.n).mean() == pytest.approx(0.6, abs=0.06)


@pytest.mark.parametrize(("law", "field"), [("energy_shaping", "force"), ("force_feedback", "state")])
def test_forces_and_states_of_the_law_on_all_scales(law, field):
    _, _, units, states = drawn(law, "panda")
    sizes = np.array([np.abs(getattr(at, field) / getattr(units, field)).max() for at in states[1:SAMPLES]])
    assert (sizes == 0.0).mean() == pytest.approx(0.2, abs=0.06)
    assert (sizes[sizes > 0.0] < 1e-4).mean() > 0.08
    assert sizes.max() <= (2.0 if field == "force" else 30.0) * (1.0 + 1e-12)
    assert sizes.max() > (1.8 if field == "force" else 10.0)
    assert (sizes > 2.0 * (1.0 + 1e-12)).mean() < 0.12  # of a logarithmic scale of 17 powers of e the last three
    alone = np.array([np.count_nonzero(getattr(at, field)) == 1 for at in states[1:SAMPLES]])
    assert 0.1 < alone.mean() < 0.3


def test_forces_on_the_tool():
    """f_e = 𝒥ᵀF: of seven numbers, three that count; some upright, some level."""
    _, plant, _, states = drawn("energy_shaping", "pera")
    of_tool, upright, level = 0, 0, 0
    for at in states[1:SAMPLES]:
        if np.count_nonzero(at.force) < 2:
            continue
        lever = plant.at(at.position).frame_jacobian(plant.robot.tool_frame, "local_world_aligned")[:3].T
        wrench, *_ = np.linalg.lstsq(lever, at.force, rcond=None)
        if np.abs(lever @ wrench - at.force).max() < 1e-9 * np.abs(at.force).max():
            of_tool += 1
            up = np.abs(wrench) > 1e-6 * np.abs(wrench).max()
            upright += up.tolist() == [False, False, True]
            level += up.sum() == 1 and not up[2]
    assert 0.08 * SAMPLES < of_tool < 0.18 * SAMPLES
    assert upright > 1.2 * level > 0.01 * SAMPLES


def test_fields_are_drawn_each_by_itself():
    """As often together as independent ones are: where it is says nothing of how fast it goes; nor sizes of sizes."""
    _, _, units, states = drawn("force_feedback", "panda")
    words = [set(at.stratum.split(", ")) for at in states[1:SAMPLES]]
    for place in PLACES:
        for speed in ("at rest", "slow", "fast"):
            expected = sum(place in said for said in words) * sum(speed in said for said in words) / len(words)
            together = sum({place, speed} <= said for said in words)
            assert abs(together - expected) <= 4.0 * np.sqrt(expected) + 1.0, (place, speed)
    forces, charges = (
        np.array([np.abs(getattr(at, field) / getattr(units, field)).max() for at in states[1:SAMPLES]])
        for field in ("force", "state")
    )
    small = (forces > 0.0) & (charges > 0.0) & (forces < 0.5) & (charges < 0.5)
    assert small.sum() > 80
    assert abs(np.corrcoef(np.log(forces[small]), np.log(charges[small]))[0, 1]) < 0.35


def test_times():
    times = np.array([at.time for at in drawn("energy_shaping", "panda")[3][1:SAMPLES]])
    assert (times == 0.0).mean() == pytest.approx(0.125, abs=0.04)
    # 5 of 8 even over a minute; of a quarter, from 1 ms to 1e5 s, what is below one
    early = 0.625 + 0.25 * np.log(60.0 / 1e-3) / np.log(1e5 / 1e-3)
    assert ((times > 0.0) & (times <= 60.0)).mean() == pytest.approx(early, abs=0.05)
    assert 1e4 < times.max() <= 1e5
    made, _, _, states = drawn("tracking", "panda")
    times = np.array([at.time for at in states[:SAMPLES]])
    assert times.min() == pytest.approx(5e-3)  # room for differences
    assert (times <= 1.25 * made.time_span).mean() > 0.6
    late = (times >= 0.5 * made.time_span) & (times <= 1.25 * made.time_span)
    assert late.mean() == pytest.approx(0.625 * 0.6, abs=0.06)  # 5 of 8 are even over 1.25 spans
    assert 20.0 * made.time_span < times.max() <= 200.0 * made.time_span


def test_along_a_reference_places_are_about_where_it_is():
    made = drawn("tracking", "panda")[0]
    for at in seen("tracking", "panda", "at the goal"):
        np.testing.assert_allclose(at.position, made.trajectory.at(at.time).position, atol=1e-12)
    for at in seen("tracking", "panda", "with the reference"):
        np.testing.assert_allclose(at.velocity, made.trajectory.at(at.time).velocity, atol=1e-6)
    slow = [at.velocity - made.trajectory.at(at.time).velocity for at in seen("tracking", "panda", "slow")]
    # 4 of 7 are away from it, not from rest, and every second of them by less than a thousandth
    assert np.mean(np.abs(slow).max(axis=1) < 2e-3) == pytest.approx(2.0 / 7.0, abs=0.06)


@pytest.mark.parametrize(("lost", "share"), [("hold", 0.1), ("error", 0.0)])
def test_now_and_then_there_is_nothing_to_see_where_the_law_allows_that(lost, share):
    states = drawn("hamiltonian_servo", "pera", 3, 256, 0.0, lost)[3]
    blind = [at for at in states[:256] if isinstance(at.scene, EmptyScene)]
    assert len(blind) == pytest.approx(share * 256, rel=0.4)
    assert all(at.scene is not None for at in states)
    assert all(at.stratum.endswith("nothing to see") for at in blind)
