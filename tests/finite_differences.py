"""Derivatives by central differences of fourth order: what analytic ones are compared with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def derivative(function: Callable[[float], np.ndarray], step: float = 1e-3) -> np.ndarray:
    """Return d function(h) / dh at 0; its error is of the order of step⁴."""
    near = function(step) - function(-step)
    far = function(2.0 * step) - function(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


def gradient(function: Callable[[np.ndarray], np.ndarray], point: np.ndarray, step: float = 1e-3) -> np.ndarray:
    """Return the derivatives along each axis, stacked first."""
    axes = np.eye(point.size)
    return np.array([derivative(lambda h, axis=axis: function(point + h * axis), step) for axis in axes])


def relative_error(actual: np.ndarray, expected: np.ndarray) -> float:
    """Return max |actual − expected| over max |expected|, at least 1."""
    return float(np.abs(np.asarray(actual) - expected).max() / max(1.0, np.abs(expected).max()))
