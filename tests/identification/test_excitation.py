"""Exciting motions by what they are said to be: as large as limits let them, and how well parameters show in them."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, Limits, MechanicalSystem, exciting_trajectory, load_robot
from phcontrol.identification.excitation import _Search
from phcontrol.identification.parameters import parameters_of

SHARE = 0.8


@pytest.fixture(scope="module")
def system():
    return MechanicalSystem(load_robot("pera_shoulder"))


def sampled(motion, samples=4000):
    """Position and velocity over a period, much finer than the search looks."""
    moments = [motion.at(t) for t in np.linspace(0.0, motion.series.period, samples)]
    return (np.array([moment[i] for moment in moments]) for i in (0, 1))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("speed", [0.3, 50.0])  # the speed is in the way, and the stops are
def test_every_joint_goes_as_far_or_as_fast_as_it_may(system, speed, seed):
    limits = Limits(system, velocity=speed, effort=1e4)
    start = 0.9 * limits.lower + 0.1 * limits.upper  # nearer to one side
    options = {"what": ("viscous",), "start": start, "share": SHARE, "candidates": 4, "seed": seed}
    motion = exciting_trajectory(system, limits, 12.0, **options)
    position, velocity = sampled(motion)
    room = np.where(position > start, limits.upper - start, start - limits.lower)
    way, fast = (np.abs(position - start) / room).max(axis=0), np.abs(velocity).max(axis=0) / limits.velocity
    np.testing.assert_allclose(np.maximum(way, fast), SHARE, rtol=1e-3)
    assert motion.used["position"] == pytest.approx(way.max(), rel=1e-3)
    assert motion.used["velocity"] == pytest.approx(fast.max(), rel=1e-3)
    assert max(motion.used.values()) == pytest.approx(SHARE, rel=1e-9)  # at the times that were looked at


def test_the_size_of_a_motion_is_that_of_the_limits_and_not_of_the_draw(system, rng):
    limits = Limits(system, effort=1e4)
    place = system.robot.near_home()
    search = _Search(system, limits, parameters_of(system.robot, ("viscous",), None), place, 6.0, 4, SHARE)
    raw = rng.normal(size=(2, 2, 4))
    large, small = search._inside(raw), search._inside(1e-3 * raw)
    for t in (0.4, 1.7, 4.4):
        np.testing.assert_allclose(small.at(t).position, large.at(t).position, rtol=1e-9)


def test_the_condition_number_of_friction_is_that_of_the_speeds(system):
    """With viscous friction alone each joint has one column, its own speed over its effort limit: no two overlap."""
    limits = Limits(system)
    motion = exciting_trajectory(system, limits, 12.0, what=("viscous",), candidates=3)
    scales = parameters_of(system.robot, ("viscous",), None).scales
    _, velocity = sampled(motion)
    sizes = np.sqrt((velocity[:-1] ** 2).mean(axis=0)) / limits.effort * scales
    assert motion.condition == pytest.approx(sizes.max() / sizes.min(), rel=1e-3)
    assert motion.condition > 1.02


def test_a_short_motion_is_one_period_and_begins_off_the_stops(system):
    options = {"what": ("viscous",), "candidates": 2}
    for duration, period in ((9.9, 9.9), (10.0, 5.0), (16.0, 8.0)):
        assert exciting_trajectory(system, duration=duration, **options).series.period == period
    plain, told = (exciting_trajectory(system, **more, **options).series for more in ({}, {"harmonics": 5}))
    np.testing.assert_array_equal(plain.at(1.3).position, told.at(1.3).position)
    limits = Limits(system)
    for stop in (limits.lower, limits.upper):
        start = np.array(system.robot.near_home())
        start[1] = stop[1]
        with pytest.raises(InvalidArgumentError, match="start: is at a limit of position"):
            exciting_trajectory(system, limits, start=start, **options)
