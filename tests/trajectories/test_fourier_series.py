"""A motion that is a Fourier series: derivatives, period, start, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import FourierSeries, InvalidArgumentError
from phcontrol.trajectories.trajectory import check_trajectory


def series(rng):
    return FourierSeries([0.3, -0.2], rng.normal(size=(2, 4)), rng.normal(size=(2, 4)), 5.0)


def test_velocity_and_acceleration_are_derivatives(rng):
    motion, h = series(rng), 1e-4
    check_trajectory("motion", motion, 2)
    for t in (0.0, 1.3, 4.9):
        ahead, behind, here = motion.at(t + h), motion.at(t - h), motion.at(t)
        np.testing.assert_allclose((ahead.position - behind.position) / (2 * h), here.velocity, atol=1e-6)
        np.testing.assert_allclose((ahead.velocity - behind.velocity) / (2 * h), here.acceleration, atol=1e-5)


def test_it_starts_where_it_is_told_and_comes_round(rng):
    motion = series(rng)
    np.testing.assert_allclose(motion.at(0.0).position, [0.3, -0.2], atol=1e-15)
    for first, second in zip(motion.at(1.1), motion.at(6.1), strict=True):
        np.testing.assert_allclose(first, second, atol=1e-12)


def test_bad_input():
    with pytest.raises(InvalidArgumentError, match=r"sine: must have the shape \(n, harmonics\) of cosine"):
        FourierSeries([0.0], [[1.0, 2.0]], [[1.0]], 1.0)
    with pytest.raises(InvalidArgumentError, match="period: must be > 0"):
        FourierSeries([0.0], [[1.0]], [[1.0]], 0.0)
    with pytest.raises(InvalidArgumentError, match="start: must have shape"):
        FourierSeries([0.0, 1.0], [[1.0]], [[1.0]], 1.0)
